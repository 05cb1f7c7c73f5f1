"""SPA-Priv at the fridge: door geometry, base maneuvers, and base poses."""

from __future__ import annotations

import math
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
from hab_spa.motion.drive import STEP_M, STEP_RAD
from hab_spa.motion.robot import Robot, SpaConfig
from hab_spa.planning.arm_plan import path_rad
from hab_spa.scenes.true_scene import TrueScene
from hab_spa.skills.fridge.config import FridgeConfig, pull_of
from hab_spa.skills.fridge.door import Door
from hab_spa.skills.fridge.exit import ExitConfig, wider
from hab_spa.skills.fridge.maneuver import base_maneuvers
from hab_spa.skills.fridge.skill import MAX_SCORE, fridge_base_poses, fridge_score
from hab_spa.skills.fridge.tow import TowConfig, tows, with_base, without_base

from hab_tasks.constants import GRASP_RADIUS_M
from hab_tasks.privileged import ArticulationState


def door_at(joint: float) -> ArticulationState:
    """Hinge at the origin, frame along the world's axes, closed along +y; opens clockwise."""
    turn = np.array(((np.cos(joint), np.sin(joint)), (-np.sin(joint), np.cos(joint))))
    handle = turn @ (0.1, 0.6)
    return ArticulationState(
        kind="fridge",
        body="fridge/door",
        handle_m=np.append(handle, 1.2),
        held=False,
        joint=joint,
        limits=(0.0, 2.3),
        slides=False,
        axis=np.array((0.0, 0.0, -1.0)),
        axis_point_m=np.array((0.0, 0.0, 1.4)),
        frame=np.zeros(3),
    )


def test_door_is_the_same_however_far_it_is_open():
    for joint in (0.0, 0.7):
        door = Door(door_at(joint))
        np.testing.assert_allclose(door.handle_m, (0.6, 0.1), atol=1e-9)
        np.testing.assert_allclose(door.handle(0.0), (0.1, 0.6, 1.2), atol=1e-9)
        # A quarter turn clockwise takes +y to +x and +x to -y.
        np.testing.assert_allclose(door.handle(math.pi / 2), (0.6, -0.1, 1.2), atol=1e-9)
        np.testing.assert_allclose(door.beside(np.array((0.6, -0.1)), math.pi / 2), (0.6, 0.1))


def test_gap_to_the_door():
    door = Door(door_at(1.0))

    # The handle is 0.1 off the hinge's plane, and 0.04 off the face; the edge is at 0.68.
    points = np.array(((0.1, 0.6), (0.03, 0.3), (0.06, 0.78), (0.36, 0.3)))
    np.testing.assert_allclose(door.gap_m(points, 0.0), (0.04, 0.0, 0.1, 0.3), atol=1e-9)
    # Opened by 90 degrees the door lies along +x, with its outer face at y = -0.06.
    np.testing.assert_allclose(door.gap_m(np.array((0.5, -0.16)), math.pi / 2), 0.1, atol=1e-9)


def test_a_pull_tells_when_the_door_is_far_enough():
    config = FridgeConfig(open_need=0.6, opened=1.6, close_need=0.45, closed=0.1, close_to=0.05)
    opening = pull_of(door_at(0.0), True, config)
    closing = pull_of(door_at(1.5), False, config)

    assert [opening.is_sufficient(joint) for joint in (0.59, 0.61)] == [False, True]
    assert [opening.is_complete(joint) for joint in (1.59, 1.61)] == [False, True]
    assert [closing.is_sufficient(joint) for joint in (1.06, 1.04)] == [False, True]
    assert [closing.is_complete(joint) for joint in (0.11, 0.09)] == [False, True]
    np.testing.assert_allclose(closing.swept, (0.05, 1.5))


def test_a_door_that_is_nearly_open_need_not_be_led_beyond_what_is_open():
    config = FridgeConfig(open_need=0.6, open_more=0.25, opened=1.6)

    # From 1.0 rad a way to 1.25 rad will do; from 1.5 rad it has to go all the way.
    assert pull_of(door_at(1.0), True, config).need == pytest.approx(1.25)
    assert pull_of(door_at(1.5), True, config).need == pytest.approx(1.6)


@pytest.mark.parametrize("joint", [0.0, 1.79])
def test_the_snap_grasp_reaches_the_handle_from_all_round_the_edge(joint):
    articulation = door_at(joint)
    door, pull = Door(articulation), pull_of(articulation, joint < 0.5, FridgeConfig())

    # The handle is at (0.6, 0.1); the edge at 0.68, the outer face at 0.06.
    places = np.array(pull.grasps_m)
    points = np.array([door.point(joint, *place) for place in places])

    assert (np.linalg.norm(points - articulation.handle_m, axis=1) < GRASP_RADIUS_M - 0.01).all()
    assert ((places[:, 0] > door.edge_m) & (places[:, 1] < 0.06)).any()
    assert ((places[:, 0] < door.edge_m) & (places[:, 1] < 0.0)).any()


def test_shunts_end_at_the_goal_in_every_way():
    base, goal = np.array((1.0, 0.0, 0.0)), np.array((0.0, 0.0, math.pi / 2))

    found = base_maneuvers(base, goal)

    assert len(found) == 8
    for maneuver in found:
        end = maneuver.poses()[-1]
        np.testing.assert_allclose(end[:2], goal[:2], atol=1e-9)
        assert math.isclose(math.remainder(end[2] - goal[2], math.tau), 0.0, abs_tol=1e-9)
    # The quickest goes one metre back and turns left by a quarter.
    assert found[0].length_m == pytest.approx(-1.0)
    assert found[0].steps == pytest.approx(1.0 / STEP_M + math.pi / 2 / STEP_RAD + 12.0)


def test_shunt_in_place_only_turns():
    found = base_maneuvers(np.array((0.0, 0.0, 3.0)), np.array((0.01, 0.0, -3.0)))

    # 3 rad to -3 rad is 0.283 rad to the left.
    assert [maneuver.length_m for maneuver in found] == [0.0, 0.0]
    assert found[0].yaw_rad - 3.0 == pytest.approx(2 * math.pi - 6.0)


def test_the_base_backs_away_with_the_door_over_free_floor_only():
    """The door of `door_at` is led to 90 degrees; the robot looks at it from x = 1.0."""
    config, door = TowConfig(), Door(door_at(0.0))
    base, joints = np.array((1.0, 0.6, math.pi)), np.linspace(0.0, math.pi / 2, 9)

    def behind_a_line(poses):
        return poses[:, 1] < 0.7

    moving = tows(base, joints, len(joints), door, behind_a_line, config)

    assert 0 < len(moving) <= config.count
    np.testing.assert_allclose(moving[:, 0], np.tile(base, (len(moving), 1)))
    assert (moving[:, :, 1] < 0.7).all()
    for motion in moving:
        gaps = [door.gap_m(pose[:2], joint) for pose, joint in zip(motion, joints, strict=True)]
        assert min(gaps) >= config.door_m - 1e-9
    # A robot that stood still would have the edge of the open door 0.68 from the hinge: 0.32 before
    # it and 0.6 aside of it.
    assert door.gap_m(base[:2], math.pi / 2) == pytest.approx(math.hypot(0.32, 0.6))
    assert not len(tows(base, joints, len(joints), door, lambda poses: poses[:, 0] > 9, config))


def test_a_path_with_the_base_is_timed_by_the_slower_of_both():
    config = TowConfig(metre_rad=3.0, radian_rad=1.0)
    arc, bases = np.zeros((2, 7)), np.array(((0.0, 0.0, 0.0), (-0.3, 0.0, 0.5)))
    arc[1, 2] = 0.4

    path = with_base(arc, bases, config)

    # 0.3 m count as 0.9 rad, more than the 0.4 rad of the arm and the 0.5 rad of the turn.
    assert path_rad(path) == pytest.approx(0.9)
    back = without_base(path, config)
    np.testing.assert_allclose(back[0], arc)
    np.testing.assert_allclose(back[1], bases)


@pytest.mark.slow
@pytest.mark.parametrize("env_id", ["HabOpenFridge-v1", "HabCloseFridge-v1"])
def test_places_are_free_and_some_will_do(env_id, generated):
    _, (episode, *_) = generated(env_id)
    env = gymnasium.make(f"hab_tasks:{env_id}", control_mode="joint_target_base")
    env.reset(seed=episode.seed, options={"episode": episode})
    scene = TrueScene()
    scene.see({"privileged": env.unwrapped.privileged()}, 0)
    env.close()
    robot = Robot(scene, SpaConfig(), seed=0, deadline=200)
    map_, out = scene.floor_map(), env_id == "HabOpenFridge-v1"

    poses = fridge_base_poses(robot, 0, map_, out)
    score = fridge_score(robot, 0, map_, out)
    scores = [score(pose) for pose in poses[:8]]

    assert len(poses)
    assert map_.is_free(poses[:, :2]).all()
    assert max(scores) > MAX_SCORE / 2
    # Nothing can be done from three metres away.
    far = poses[0] + (3.0, 3.0, 0.0)
    assert score(far) == 0.0


class _Enclosing:
    """A scene whose door encloses a robot at the origin until it is open by `free_from` [rad]."""

    def __init__(self, joint, upper, free_from):
        self._joint, self._free_from = joint, free_from
        self._articulation = SimpleNamespace(joint=joint, limits=(0.0, upper))

    def articulation(self, number):
        return self._articulation

    def floor_map(self, joints=None):
        joint = self._joint if joints is None else joints[1]
        away_m = 0.0 if joint >= self._free_from else 0.8
        return SimpleNamespace(nearest_free=lambda point_m: point_m + np.array((away_m, 0.0)))


def _wider(joint, upper, free_from):
    robot = SimpleNamespace(scene=_Enclosing(joint, upper, free_from), base=np.zeros(3))
    return wider(robot, 1, FridgeConfig(), ExitConfig())


def test_a_door_that_encloses_the_robot_is_opened_as_far_as_it_takes():
    # From 1.7 in steps of 0.1: 2.0 is the first joint position that frees the robot.
    config = _wider(1.7, 2.3, 1.95)
    assert config.opened == config.let_go == pytest.approx(2.05)
    assert config.open_to == pytest.approx(2.1)
    # One that encloses nobody, and one that nothing helps, stay as they are.
    assert _wider(1.7, 2.3, 1.6) is None
    assert _wider(1.7, 1.85, 1.95) is None
