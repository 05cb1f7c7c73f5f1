import numpy as np
import pinocchio as pin
import pytest
from hab_spa.planning.collision import shared_arm_model
from hab_spa.planning.ik import LOWER_RAD, UPPER_RAD, BatchArm, IkConfig

from hab_tasks.robots.robot import ROBOT


@pytest.fixture(scope="module")
def poses():
    return np.random.default_rng(0).uniform(LOWER_RAD, UPPER_RAD, (200, 7))


def test_batch_agrees_with_pinocchio(poses):
    model, frame_id = shared_arm_model()
    data = model.createData()
    positions, jacobians = BatchArm().position_and_jacobian(poses)
    for pose, position, jacobian in zip(poses, positions, jacobians, strict=True):
        expected = pin.computeFrameJacobian(model, data, pose, frame_id, pin.LOCAL_WORLD_ALIGNED)
        np.testing.assert_allclose(position, data.oMf[frame_id].translation, atol=1e-12)
        np.testing.assert_allclose(jacobian, expected[:3], atol=1e-12)


def test_solve_reaches_positions_of_other_poses_within_tolerance(poses):
    arm, config = BatchArm(), IkConfig()
    targets_m, _ = arm.position_and_jacobian(poses)
    solutions, reached = arm.solve(np.roll(poses, 1, axis=0), targets_m, config)
    error_m = np.linalg.norm(arm.position_and_jacobian(solutions)[0] - targets_m, axis=1)
    assert reached.mean() > 0.6
    assert error_m[reached].max() <= config.tolerance_m
    assert np.all(solutions >= LOWER_RAD)
    assert np.all(solutions <= UPPER_RAD)


def test_solve_says_which_targets_are_out_of_reach():
    arm = BatchArm()
    _, reached = arm.solve(np.array([ROBOT.rest_qpos_rad]), np.array([[3.0, 0.0, 1.0]]), IkConfig())
    assert not reached.any()


def test_track_pose_keeps_the_orientation_along_a_line():
    arm, qpos = BatchArm(), np.array(ROBOT.rest_qpos_rad)
    goal = arm.ee_pose(qpos).copy()
    goal[:3, 3] += [0.0, 0.0, 0.01]
    moved = arm.track_pose(qpos, goal, steps=5, turn_weight_m=0.2)
    np.testing.assert_allclose(arm.ee_pose(moved), goal, atol=3e-3)


def test_many_poses_are_tracked_as_one_by_one():
    arm, rng = BatchArm(), np.random.default_rng(3)
    starts = np.array(ROBOT.rest_qpos_rad) + rng.normal(scale=0.2, size=(6, 7))
    goals = np.stack([arm.ee_pose(start + 0.05) for start in starts])
    weights_m = np.array((0.0, 0.05, 0.2, 0.0, 0.05, 0.2))

    together = arm.track_poses(starts, goals, 4, weights_m)

    for start, goal, weight_m, moved in zip(starts, goals, weights_m, together, strict=True):
        alone = arm.track_pose(start, goal, steps=4, turn_weight_m=float(weight_m))
        np.testing.assert_allclose(moved, alone, atol=1e-9)
