"""How a hand holds the handle of a door or drawer: taking, pulling, losing and passing through."""

from functools import partial

import numpy as np
import pytest
import sapien
from builders import box_actor
from kitchen import GRASP, RELEASE, Kitchen, opening_direction

from hab_tasks.articulations import HANDLE_MARKERS
from hab_tasks.robots.grasp import NOTHING
from hab_tasks.robots.snap_grasp import SnapGrasp
from hab_tasks.world.scenes.physics import HAND, set_groups

DRAWER, FRIDGE = HANDLE_MARKERS[2], HANDLE_MARKERS[7]
FINGERS = ("gripper_link", "l_gripper_finger_link", "r_gripper_finger_link")


def moved(kitchen, way_m):
    """Sets the hand beside where it is by a way (2,) [m]; returns the robot's joints."""
    robot = kitchen.agent.robot._objs[0]
    qpos = robot.get_qpos()
    qpos[kitchen.agent.base_index.tolist()[:2]] += way_m
    robot.set_qpos(qpos)
    robot.set_qvel(np.zeros_like(qpos))
    return qpos


@pytest.mark.parametrize("marker", [DRAWER, FRIDGE], ids=lambda m: m.name)
def test_a_held_handle_opens_drawer_and_door(marker):
    # 60 * 8 mm is 0.48 m of way; a drawer has half of that, a door opens by more than 0.3 rad.
    # 24 cm: all of a drawer's way, or 0.3 rad and more about a hinge less than 0.8 m away.
    for pulls_along, step_m, steps, opened in (
        (False, 0.008, 60, 0.15),
        (True, 0.02, 12, 0.23 if marker is DRAWER else 0.3),
    ):
        kitchen = Kitchen(marker, pulls_along=pulls_along)
        before, direction = kitchen.position(), opening_direction(kitchen)
        start = kitchen.agent.robot._objs[0].get_qpos()[kitchen.agent.base_index.tolist()[:2]]
        kitchen.grasp.command(GRASP)
        assert kitchen.grasp.held == NOTHING
        for _ in range(steps):
            kitchen.act(partial(moved, kitchen, step_m / 4 * direction))
            # The hand goes straight on; the door's handle goes round its hinge.
            assert not pulls_along or kitchen.gap_m() < (5e-3 if marker is DRAWER else 0.06)
        assert kitchen.grasp.held_handle == 0
        assert kitchen.position() - before > opened, pulls_along
        if pulls_along:
            hand = kitchen.agent.robot._objs[0].get_qpos()[kitchen.agent.base_index.tolist()[:2]]
            assert np.allclose(hand - start, steps * step_m * direction, atol=1e-3)
            for _ in range(2):
                kitchen.act()
            assert float(kitchen.furniture.get_qvel().abs().max()) < 0.02
        kitchen.grasp.command(RELEASE)
        assert not kitchen.grasp.holding


def test_a_hand_takes_what_its_skill_is_about_and_objects_before_handles():
    kitchen = Kitchen(DRAWER)
    hand = kitchen.grasp.ee_position_m()  # on the marker
    box = box_actor(kitchen.scene, "late", (0.02,) * 3, tuple(np.add(hand, (0, 0, 0.12))))
    near, far = box.pose, sapien.Pose([0.0, 0.0, 30.0])
    for takes, held, handle, alone in (
        ("any", 0, NOTHING, 0),
        ("objects", 0, NOTHING, NOTHING),
        ("handles", NOTHING, 0, 0),
    ):
        for place, found in ((near, (held, handle)), (far, (NOTHING, alone))):
            box.set_pose(place)
            grasp = SnapGrasp(kitchen.agent, [box], [kitchen.handle], takes)
            grasp.command(GRASP)
            assert (grasp.held, grasp.held_handle) == found, takes
            grasp.command(RELEASE)


def test_a_handle_taken_at_a_distance_does_not_jump():
    kitchen = Kitchen(DRAWER)
    moved(kitchen, 0.12 * opening_direction(kitchen))  # ahead of the closed drawer, into the room
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
    assert kitchen.grasp.held_handle == 0


def test_a_handle_out_of_reach_for_half_a_second_is_lost_and_far_away_at_once():
    kitchen = Kitchen(DRAWER)
    x, y = opening_direction(kitchen)
    kitchen.grasp.command(GRASP)
    qpos = moved(kitchen, 0.2 * np.array([-y, x]))  # the drawer cannot follow to the side
    for step in range(15):  # 15 actions at 30 Hz are half a second
        assert kitchen.grasp.held_handle == 0, step
        kitchen.agent.robot._objs[0].set_qpos(qpos)
        moved(kitchen, 0.0)
        kitchen.act()
    assert kitchen.grasp.held_handle == NOTHING
    assert kitchen.grasp.lost
    kitchen = Kitchen(DRAWER)
    before = kitchen.position()
    kitchen.grasp.command(GRASP)
    moved(kitchen, (-2.0, 0.0))
    kitchen.act()
    assert not kitchen.grasp.holding
    assert kitchen.position() == pytest.approx(before, abs=1e-3)


def test_the_spring_pulls_no_harder_than_its_limit():
    kitchen = Kitchen(DRAWER)
    way_m = 0.14 * opening_direction(kitchen)
    kitchen.grasp.command(GRASP)
    moved(kitchen, way_m)
    kitchen.scene.px.step()
    # One physics step: at most 200 N / m / 120, less 4 N of friction.
    impulse = float(kitchen.furniture.get_qvel().abs().max()) * kitchen.link._objs[0].mass * 120
    assert 0.5 * (200 - 4) < impulse < 1.01 * 200


def touches(kitchen, way_m):
    """Whether the hand, set beside where it is, meets the drawer with more than 10 N."""
    robot, furniture = kitchen.agent.robot._objs[0], kitchen.furniture._objs[0]
    before, force_n = robot.get_qpos(), 0.0
    moved(kitchen, way_m)
    kitchen.scene.px.step()
    for contact in kitchen.scene.px.get_contacts():
        names = {body.entity.name for body in contact.bodies}
        if kitchen.link.name in names and names & set(FINGERS):
            force_n += sum(float(np.linalg.norm(point.impulse)) * 120 for point in contact.points)
    for piece, qpos in ((robot, before), (furniture, np.zeros(furniture.dof))):
        piece.set_qpos(qpos)
        piece.set_qvel(0.0 * qpos)
    return force_n > 10


def test_the_hand_passes_through_the_drawer_whose_handle_it_holds():
    kitchen = Kitchen(DRAWER)
    for name in FINGERS:
        set_groups(kitchen.agent.robot.links_map[name]._objs[0], HAND)
    into_m = -0.1 * opening_direction(kitchen)  # the fingers in the front of the drawer
    free = kitchen.grasp.get_state()
    assert touches(kitchen, into_m)
    kitchen.grasp.command(GRASP)
    held = kitchen.grasp.get_state()
    assert not touches(kitchen, into_m)
    kitchen.grasp.command(RELEASE)
    kitchen.grasp.after_control_step()
    assert not touches(kitchen, into_m)  # until the hand has left the handle
    moved(kitchen, -3 * into_m)
    kitchen.grasp.after_control_step()
    moved(kitchen, 3 * into_m)
    assert touches(kitchen, into_m)
    for state, free_again in ((held, False), (free, True)):
        kitchen.grasp.set_state(state)
        assert touches(kitchen, into_m) == free_again
