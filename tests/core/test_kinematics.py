"""The arm's kinematics: derivatives, batch against single rows, and the IK step."""

import numpy as np
import pytest
import torch

from hab_tasks.constants import EE_STEP_M, REST_POSITION_M
from hab_tasks.robots.kinematics import ArmKinematics, arm_model
from hab_tasks.robots.robot import ROBOT

LOWER, UPPER = np.array(ROBOT.arm_lower_rad), np.array(ROBOT.arm_upper_rad)
REST = np.array(ROBOT.rest_qpos_rad)
POSES = np.random.default_rng(0).uniform(LOWER, UPPER, (20, 7))


@pytest.fixture(scope="module")
def kinematics():
    return ArmKinematics()


def test_rest_pose_puts_the_hand_on_the_resting_position(kinematics):
    assert np.linalg.norm(kinematics.position(REST) - REST_POSITION_M) < 1e-4
    model, _ = arm_model()
    assert model.nq == 7
    # The URDF rounds its limits to four digits.
    assert np.allclose(model.lowerPositionLimit, LOWER, atol=1e-3)
    assert np.allclose(model.upperPositionLimit, UPPER, atol=1e-3)


def test_jacobian_equals_central_differences(kinematics):
    step = 1e-6
    for qpos in POSES[:8]:
        ways = [
            kinematics.position(qpos + step * e) - kinematics.position(qpos - step * e)
            for e in np.eye(7)
        ]
        position, jacobian = kinematics.position_and_jacobian(qpos)
        assert np.allclose(jacobian, np.stack(ways, axis=1) / (2 * step), atol=1e-6)
        assert np.allclose(position, kinematics.position(qpos))


def test_batch_equals_single_rows(kinematics):
    rows = torch.tensor(POSES)
    positions, jacobians = kinematics.batch_position_and_jacobian(rows)
    targets = positions + torch.tensor([0.01, -0.005, 0.008], dtype=torch.float64)
    moved = kinematics.batch_displace(rows, targets)
    for i, qpos in enumerate(POSES):
        position, jacobian = kinematics.position_and_jacobian(qpos)
        assert np.allclose(positions[i], position, atol=1e-5)
        assert np.allclose(jacobians[i], jacobian, atol=1e-5)
        assert np.allclose(moved[i], kinematics.displace(qpos, targets[i].numpy()), atol=1e-4)


def test_a_step_from_rest_moves_the_hand_by_what_was_asked(kinematics):
    # Damping 0.02 shortens a step in singular directions; near rest a tenth at the most.
    before = kinematics.position(REST)
    for axis in np.vstack((np.eye(3), -np.eye(3))):
        moved = kinematics.position(kinematics.displace(REST, before + EE_STEP_M * axis)) - before
        assert np.linalg.norm(moved - EE_STEP_M * axis) < 0.1 * EE_STEP_M, axis


def test_a_step_stays_within_the_joints_limits(kinematics):
    for qpos in np.clip(POSES + 3.0, LOWER, UPPER):  # most joints at their upper limit
        moved = kinematics.displace(qpos, np.array([3.0, -3.0, 3.0]))
        assert (moved >= LOWER).all()
        assert (moved <= UPPER).all()


def test_a_joint_at_its_limit_does_not_bend_the_step(kinematics):
    """Upwards from rest with the shoulder's lift at its limit: the other joints make the step."""
    qpos = REST.copy()
    qpos[1] = ROBOT.arm_lower_rad[1]
    before = kinematics.position(qpos)
    step = np.array([0.0, 0.0, EE_STEP_M])
    after = kinematics.displace(qpos, before + step)
    assert np.all(after >= LOWER)
    assert np.all(after <= UPPER)
    # Without the second solve the clipped joint's share is lost: 8 mm of the 15 upwards.
    assert np.linalg.norm(kinematics.position(after) - before - step) < 1e-3
    row = torch.from_numpy(qpos)[None]
    batch = kinematics.batch_displace(row, torch.from_numpy(before + step)[None])
    assert torch.allclose(batch[0], torch.from_numpy(after), atol=1e-6)
