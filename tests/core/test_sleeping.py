"""Frozen objects: they wake in time, do not float, and reduce the cost of a step."""

import numpy as np
import pytest
import sapien
import torch
from builders import box_actor, cpu_scene, start_fetch
from fetch_sim import HAND_M, FetchSim

from hab_tasks.articulations import HANDLE_MARKERS
from hab_tasks.robots.fetch.agent import HabFetch
from hab_tasks.robots.sleeping import SleepingObjects
from hab_tasks.world.scenes.habitat.dataset import resolve_dataset
from hab_tasks.world.scenes.habitat.load import load_scene
from hab_tasks.world.scenes.physics import STATIC, set_groups
from hab_tasks.world.scenes.pool import BodyPool

SMALL = (0.03, 0.03, 0.03)
NOBODY = -1


class RobotSim(FetchSim):
    """The robot at rest, boxes on a table (top at `table_m`), everything frozen."""

    def __init__(self, positions, *, mode="joint_target", table_m=0.7):
        boxes = [(SMALL, np.subtract(position, HAND_M)) for position in positions]
        table = ((0.5, 2.0, 0.05), np.subtract((1.2, 0.0, table_m - 0.05), HAND_M))
        super().__init__(mode, boxes, [table], floating=False)
        set_groups(self.scene.actors["wall0"]._bodies[0], STATIC)
        self.boxes = self.objects
        self.sleeping = SleepingObjects(self.boxes, self.agent, [])
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
        return self.agent.controller.arm_target_rad.copy()


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
    sim = RobotSim([(0.9, 0.0, 0.031)], mode="joint_target_base", table_m=0.0)
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


# Near moving furniture: the apartment's counter -------------------------------------------------

MARKER = next(m for m in HANDLE_MARKERS if m.name == "cab_push_point_5")
TINY = (0.02, 0.02, 0.02)


class Counter:
    """The counter's drawer, a box in it, one 0.45 m in front of its handle and one far away."""

    def __init__(self):
        dataset = resolve_dataset("apartment")
        spec = load_scene(dataset, sorted(dataset.scene_files)[0])
        self.scene = cpu_scene()
        self.agent = HabFetch(self.scene, 30, "joint_target")
        self.boxes = [box_actor(self.scene, f"box{i}", TINY, (0, 0, 9 + i)) for i in range(3)]
        built = BodyPool(self.scene, {}).show(spec, ())
        self.scene._setup(enable_gpu=False)
        start_fetch(self.agent)
        self.counter = built.articulations[MARKER.template + "_:0000"]
        self.link = self.counter.links_map[MARKER.link]
        joints = [joint.name for joint in self.counter.active_joints]
        self.column = joints.index(self.link.joint.name)
        furniture = list(built.articulations.values())
        self.sleeping = SleepingObjects(self.boxes, self.agent, furniture)
        self.sleeping.thaw_all()
        self.put_boxes()
        self.sleeping.freeze_all(np.ones(3, dtype=bool))

    def handle_m(self):
        return (self.link.pose.sp * sapien.Pose(list(MARKER.offset_m))).p

    def put_boxes(self):
        inside = np.mean(self.link._objs[0].compute_global_aabb_tight(), axis=0)
        handle_m = self.handle_m()
        self.open(0.05)
        ahead = (self.handle_m() - handle_m) / np.linalg.norm(self.handle_m() - handle_m)
        self.open(0.0)
        for box, point in zip(self.boxes, (inside, handle_m + 0.45 * ahead), strict=False):
            box.set_pose(sapien.Pose(point))
            box._bodies[0].disable_gravity = True

    def open(self, position_m):
        qpos = self.counter.get_qpos()
        qpos[0, self.column] = position_m
        self.counter.set_qpos(qpos)

    def frozen(self):
        return [box._bodies[0].kinematic for box in self.boxes]


def test_a_drawer_on_the_move_wakes_what_is_in_it_and_before_it_and_at_rest_nobody():
    counter = Counter()
    for touching in (*(True, False) * 15, True):
        counter.sleeping.before_step(NOBODY, touching)
    assert counter.frozen() == [True, True, True]
    counter.open(0.002)
    counter.sleeping.before_step(NOBODY, True)
    assert counter.frozen() == [False, True, True]
    # It wakes the box 0.45 m ahead of its handle 0.1 m before it, also when the hand has left the
    # drawer, which slides on, and nothing is in it.
    counter.sleeping.freeze_all(np.array([False, True, True]))
    position, touching = 0.0, True
    while counter.frozen()[1]:
        position += 0.01
        counter.open(position)
        counter.sleeping.before_step(NOBODY, touching)
        touching = False
    assert position == pytest.approx(0.45 - 0.02 - 0.1, abs=0.06)
    assert counter.frozen() == [True, False, True]
