"""Drawers: moving bodies in the collision model, and lines of a handle."""

from dataclasses import replace

import numpy as np
import pytest
from hab_spa.motion.robot import Robot, SpaConfig
from hab_spa.planning.collision import ArmCollision, CollisionConfig
from hab_spa.scenes.true_scene import TrueScene
from hab_spa.skills.drawer_lines import HandleLines, LineConfig

from hab_tasks.robots.fetch import FETCH

# The tray's handle is 3 cm before its front, which is 0.62 m ahead of the robot; the drawer
# opens towards the robot, by up to 0.2 m.
HANDLE_M = (0.60, 0.0, 0.85)
TRAY_M, TRAY_SIZE_M = (0.80, 0.0, 0.85), (0.34, 0.3, 0.1)


@pytest.fixture
def tray(make_scene, drawer_at):
    """A drawer without furniture, with a box in it."""
    made = make_scene()
    made.add_box("tray", "furniture", TRAY_M, TRAY_SIZE_M)
    made.add_box("content", "object", (0.80, 0.0, 0.88), (0.04, 0.04, 0.04))
    made.add_box("beside", "object", (0.80, 0.4, 0.88), (0.04, 0.04, 0.04))
    scene, articulation = TrueScene(FETCH), drawer_at("tray", HANDLE_M, 0.2)
    state = replace(made.privileged("content"), articulations=(articulation,))
    scene.see({"privileged": [state]}, 0)
    return scene


def shifted(state, offset_m):
    """The tray and what is in it so much farther along x, nothing else."""
    poses = {name: pose.copy() for name, pose in state.world_from_body.items()}
    for name in ("tray", "content"):
        poses[name][0, 3] += offset_m
    return replace(state, world_from_body=poses)


def test_a_moved_body_takes_along_what_lies_in_it(tray):
    config = CollisionConfig(margin_m=0.0)
    model = ArmCollision(FETCH, tray.state, config=config)
    motion = np.eye(4)
    motion[0, 3] = -0.2
    poses = np.random.default_rng(0).uniform(FETCH.arm_lower_rad, FETCH.arm_upper_rad, (400, 7))
    before = [model.is_free(pose) for pose in poses]
    assert model.move("tray", motion)
    expected = ArmCollision(FETCH, shifted(tray.state, -0.2), config=config)
    after = [model.is_free(pose) for pose in poses]
    assert after == [expected.is_free(pose) for pose in poses]
    assert after != before
    # Each motion counts from where the body was in the state, not from the last one.
    assert model.move("tray", np.eye(4))
    assert [model.is_free(pose) for pose in poses] == before
    assert not model.move("cupboard", motion)


def test_lines_take_the_handle_all_the_way_clear_of_the_drawer_and_depend_on_the_seed(tray):
    robot = Robot(tray, SpaConfig(), seed=0, deadline=200)
    found = HandleLines(robot, tray.articulation(0), 0.18, LineConfig())
    lines, again = found.find(seed=0), found.find(seed=0)
    assert lines
    np.testing.assert_array_equal(lines[0].poses, again[0].poses)
    # 0.18 m in steps of at most 0.02 m: nine steps, ten arm poses.
    assert {len(line.poses) for line in lines} == {10}
    for line in lines:
        assert line.missing_m == pytest.approx(0.0)
        for step, pose in enumerate(line.poses):
            hand_m = robot.kinematics.ee_pose(pose)[:3, 3]
            wanted_m = np.array(HANDLE_M) - (0.02 * step, 0.0, 0.0)
            arm_from_world = tray.collision().arm_from_world
            wanted_m = arm_from_world[:3, :3] @ wanted_m + arm_from_world[:3, 3]
            assert np.linalg.norm(hand_m - wanted_m) < 0.005
            model = ArmCollision(FETCH, shifted(tray.state, -0.02 * step))
            model.set_margin(0.0)
            assert model.is_free(pose)
