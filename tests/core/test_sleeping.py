"""Frozen objects: they wake in time, do not float, and reduce the cost of a step."""

import numpy as np
import pytest
import sapien
import torch
from fetch_sim import HAND_M, FetchSim

from hab_tasks.robots.sleeping import SleepingObjects
from hab_tasks.scenes.collision_groups import STATIC, set_groups

SMALL = (0.03, 0.03, 0.03)
NOBODY = -1


class RobotSim(FetchSim):
    """The robot at rest, boxes on a table (top at `table_m`), everything frozen."""

    def __init__(self, positions, *, mobile=False, mode="joint_target", table_m=0.7):
        boxes = [(SMALL, np.subtract(position, HAND_M)) for position in positions]
        table = ((0.5, 2.0, 0.05), np.subtract((1.2, 0.0, table_m - 0.05), HAND_M))
        super().__init__(mode, boxes, [table], floating=False)
        set_groups(self.scene.actors["wall0"]._bodies[0], STATIC)
        self.boxes = self.objects
        self.sleeping = SleepingObjects(self.boxes, dict(self.agent.robot.links_map), [], mobile)
        self.sleeping.thaw_all()
        self.sleeping.freeze_all(np.ones(len(self.boxes), dtype=bool))

    def frozen(self, index=0):
        return self.boxes[index]._bodies[0].kinematic

    def height(self, index=0):
        return float(self.boxes[index].pose.p[0, 2])

    def step(self, target=None, held=NOBODY):
        """One action; returns the bodies that the robot touches."""
        if target is not None:
            action = torch.tensor(np.append(target, -1.0)[None], dtype=torch.float32)
            self.agent.controller.set_action(action)
        self.sleeping.before_step(held, True)
        links = {link._objs[0] for link in self.agent.robot.links}
        touched = set()
        for _ in range(4):
            self.scene.px.step()
            pairs = (set(contact.bodies) for contact in self.scene.px.get_contacts())
            touched.update(*(pair - links for pair in pairs if pair & links))
        self.sleeping.refresh()
        return touched

    def target(self):
        return self.agent.controller.arm_target_rad[0].numpy().copy()


def test_an_object_wakes_before_the_arm_touches_it():
    for y in (-0.3, 0.0, 0.3):
        sim = RobotSim([(0.85, y, 0.73), (0.75, y + 0.15, 0.73)])
        rng = np.random.default_rng(3)
        touches = 0
        goal = np.array([np.arctan2(y, 0.75), 0.6, 0.0, 0.6, 0.0, 0.8, 0.0])  # down onto the table
        for _ in range(60):
            asleep = [sim.boxes[i]._bodies[0] for i in range(2) if sim.frozen(i)]
            step = np.clip(goal - sim.target(), -0.06, 0.06) + 0.005 * rng.normal(size=7)
            touched = sim.step(sim.target() + step)
            assert not any(body.kinematic for body in touched.intersection(asleep))
            touches += any(box._bodies[0] in touched for box in sim.boxes)
        assert touches > 0, "the arm never came there"


def test_a_moving_base_wakes_what_stands_in_its_way():
    sim = RobotSim([(0.9, 0.0, 0.031)], mobile=True, mode="joint_target_base", table_m=0.0)
    touched = False
    for _ in range(40):
        action = np.concatenate((sim.target(), (-1.0, 0.5, 0.0)))  # half a metre a second
        sim.agent.controller.set_action(torch.tensor(action[None], dtype=torch.float32))
        hit = sim.boxes[0]._bodies[0] in sim.step()
        assert not (hit and sim.frozen())
        touched |= hit
    assert touched
    # 40 actions take the base's front, 0.3 m ahead of its middle, 0.67 m forwards.
    assert float(sim.boxes[0].pose.p[0, 0]) > 0.92


def test_a_stack_does_not_float_when_its_lower_half_goes():
    sim = RobotSim([(1.4, 0.0, 0.73), (1.4, 0.0, 0.79)])
    sim.sleeping.wake(0)
    for step in range(30):  # drawn out sideways from under the upper one, as a hand would
        sim.boxes[0].set_pose(sapien.Pose([1.4, -0.01 * (step + 1), 0.73]))
        sim.step(held=0)
    for _ in range(30):
        sim.step(held=0)
    assert sim.height(1) == pytest.approx(0.73, abs=0.01)


def test_a_hundred_objects_out_of_reach_stay_as_they_are_and_make_no_contacts():
    """The engine's own count of work: contacts, as time on a shared machine says little."""
    far = [(1.0 + 0.08 * (i % 10), 0.9 + 0.1 * (i // 10), 0.73) for i in range(100)]
    sim = RobotSim([*far, (0.75, 0.0, 0.73)])
    before = [box.pose.raw_pose.clone() for box in sim.boxes]
    for _ in range(20):
        sim.step(sim.target() + 0.01)
    bodies = {box._bodies[0] for box in sim.boxes[:100]}
    contacts = [c for c in sim.scene.px.get_contacts() if bodies & set(c.bodies)]
    assert len(contacts) <= 4
    for index in range(10, 100):
        assert sim.frozen(index)
        assert torch.equal(sim.boxes[index].pose.raw_pose, before[index])
