"""The spring that holds a handle: force, position in the hand, and loss."""

import numpy as np
import pytest
import torch
from kitchen import GRASP, RELEASE, Kitchen, opening_direction

from hab_tasks.robots.drive_grasp import DriveGrasp
from hab_tasks.robots.follow_grasp import FollowGrasp
from hab_tasks.robots.grasp import NOTHING
from hab_tasks.robots.handle_tie import HANDLE_SPRING
from hab_tasks.scenes.collision_groups import HAND, set_groups
from hab_tasks.scenes.markers import HANDLE_MARKERS

DRAWER = HANDLE_MARKERS[2]
every_kind = pytest.mark.parametrize("kind", [DriveGrasp, FollowGrasp])


def moved(kitchen, way_m):
    """Sets the hand beside the handle by a way (2,) [m]."""
    robot = kitchen.agent.robot._objs[0]
    qpos = robot.get_qpos()
    qpos[kitchen.agent.base_index.tolist()[:2]] += way_m
    robot.set_qpos(qpos)
    robot.set_qvel(np.zeros_like(qpos))


def test_a_handle_is_drawn_in_by_the_hands_own_step():
    place = np.array([0.0, 0.03, 0.04], dtype=np.float32)  # 0.05 m away
    place = HANDLE_SPRING.drawn_in(place)
    # 0.05 - 0.015 = 0.035 m, in the same direction: 0.7 of each entry
    assert np.allclose(place, [0.0, 0.021, 0.028])
    for _ in range(2):
        place = HANDLE_SPRING.drawn_in(place)
    # 0.035 - 2 * 0.015 = 0.005 m are left; the next step takes the rest
    assert np.linalg.norm(place) == pytest.approx(0.005, abs=1e-6)
    assert not HANDLE_SPRING.drawn_in(place).any()


@every_kind
def test_a_handle_taken_at_a_distance_does_not_jump(kind):
    kitchen = Kitchen(kind, DRAWER)
    direction = opening_direction(kitchen)
    moved(kitchen, 0.12 * direction)  # ahead of the closed drawer, into the room
    assert kitchen.gap_m() == pytest.approx(0.12, abs=1e-3)
    kitchen.grasp.command(GRASP)
    before = kitchen.position()
    for _ in range(20):
        kitchen.act()
        after = kitchen.position()
        # 1.5 cm in an action; the spring may swing by a third of that.
        assert after - before < 0.02
        before = after
    assert kitchen.position() == pytest.approx(0.12, abs=0.02)
    assert kitchen.grasp.held_handle.tolist() == [0]


@every_kind
def test_a_handle_out_of_reach_for_half_a_second_is_lost(kind):
    kitchen = Kitchen(kind, DRAWER)
    kitchen.grasp.command(GRASP)
    side = np.array([-opening_direction(kitchen)[1], opening_direction(kitchen)[0]])
    robot = kitchen.agent.robot._objs[0]
    moved(kitchen, 0.2 * side)  # the drawer cannot follow to the side
    qpos = robot.get_qpos()
    for step in range(15):  # 15 actions at 30 Hz are half a second
        assert kitchen.grasp.held_handle.tolist() == [0], step
        robot.set_qpos(qpos)
        robot.set_qvel(np.zeros_like(qpos))
        kitchen.act()
    assert kitchen.grasp.held_handle.tolist() == [NOTHING]
    assert kitchen.grasp.lost.tolist() == [True]


def test_the_spring_pulls_no_harder_than_its_limit():
    kitchen = Kitchen(DriveGrasp, DRAWER)
    direction = opening_direction(kitchen)
    kitchen.grasp.command(GRASP)
    moved(kitchen, 0.14 * direction)
    kitchen.scene.px.step()
    speed = float(kitchen.furniture.get_qvel().abs().max())
    mass_kg = float(kitchen.link._objs[0].mass)
    # One physics step: at most 200 N / m / 120, less 4 N of friction.
    assert 0.5 * (200 - 4) / mass_kg / 120 < speed < 1.01 * 200 / mass_kg / 120


@every_kind
def test_the_state_keeps_how_a_handle_is_held(kind):
    kitchen = Kitchen(kind, DRAWER)
    moved(kitchen, 0.1 * opening_direction(kitchen))
    kitchen.grasp.command(GRASP)
    kitchen.act()
    state = kitchen.grasp.get_state()
    assert float(torch.linalg.norm(state["handle_in_ee_m"])) == pytest.approx(0.085, abs=2e-3)
    kitchen.grasp.reset(torch.zeros(1, dtype=torch.long))
    state["steps_apart"] = torch.tensor([14])
    kitchen.grasp.set_state(state, torch.zeros(1, dtype=torch.long))
    assert kitchen.grasp.held_handle.tolist() == [0]
    assert torch.equal(kitchen.grasp.get_state()["handle_in_ee_m"], state["handle_in_ee_m"])
    moved(kitchen, 0.1 * opening_direction(kitchen))
    kitchen.grasp.after_control_step()  # the fifteenth action out of reach
    assert kitchen.grasp.held_handle.tolist() == [NOTHING]


FINGERS = ("gripper_link", "l_gripper_finger_link", "r_gripper_finger_link")


def hand_contacts_n(kitchen, way_m):
    """Sum of the contact forces [N] of the hand, set beside the handle, and the drawer."""
    robot = kitchen.agent.robot._objs[0]
    before = robot.get_qpos()
    moved(kitchen, way_m)
    kitchen.scene.px.step()
    total = 0.0
    for contact in kitchen.scene.sub_scenes[0].get_contacts():
        names = [body.entity.name for body in contact.bodies]
        if kitchen.link.name in names and set(names) & set(FINGERS):
            total += sum(float(np.linalg.norm(point.impulse)) * 120 for point in contact.points)
    robot.set_qpos(before)
    robot.set_qvel(np.zeros_like(before))
    kitchen.furniture.set_qpos(torch.zeros_like(kitchen.furniture.get_qpos()))
    kitchen.furniture.set_qvel(torch.zeros_like(kitchen.furniture.get_qpos()))
    return total


def test_the_hand_passes_through_the_drawer_whose_handle_it_holds():
    kitchen, row = Kitchen(DriveGrasp, DRAWER), torch.zeros(1, dtype=torch.long)
    for name in FINGERS:
        set_groups(kitchen.agent.robot.links_map[name]._objs[0], HAND)
    into_m = -0.1 * opening_direction(kitchen)  # the fingers in the front of the drawer
    free = kitchen.grasp.get_state()
    assert hand_contacts_n(kitchen, into_m) > 10
    kitchen.grasp.command(GRASP)
    held = kitchen.grasp.get_state()
    assert hand_contacts_n(kitchen, into_m) == 0
    kitchen.grasp.command(RELEASE)
    kitchen.grasp.after_control_step()
    assert hand_contacts_n(kitchen, into_m) == 0  # until the hand has left the handle
    moved(kitchen, -3 * into_m)
    kitchen.grasp.after_control_step()
    moved(kitchen, 3 * into_m)
    assert hand_contacts_n(kitchen, into_m) > 10
    kitchen.grasp.set_state(held, row)
    assert hand_contacts_n(kitchen, into_m) == 0
    kitchen.grasp.set_state(free, row)
    assert hand_contacts_n(kitchen, into_m) > 10
    assert (held["passed"].tolist(), free["passed"].tolist()) == ([[True]], [[False]])
