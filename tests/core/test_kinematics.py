"""The arm's kinematics: derivatives and the IK step."""

import numpy as np

from hab_tasks.constants import EE_STEP_M, REST_POSITION_M
from hab_tasks.robots.fetch import FETCH
from hab_tasks.robots.kinematics import ArmKinematics

LOWER, UPPER = np.array(FETCH.arm_lower_rad), np.array(FETCH.arm_upper_rad)
REST = np.array(FETCH.rest_qpos_rad)
POSES = np.random.default_rng(0).uniform(LOWER, UPPER, (20, 7))
ARM = ArmKinematics(FETCH)


def test_jacobian_equals_central_differences():
    for qpos in POSES[:8]:
        ways = [ARM.position(qpos + step) - ARM.position(qpos - step) for step in 1e-6 * np.eye(7)]
        position, jacobian = ARM.position_and_jacobian(qpos)
        assert np.allclose(jacobian, np.stack(ways, axis=1) / 2e-6, atol=1e-6)
        assert np.allclose(position, ARM.position(qpos))


def test_a_step_from_rest_moves_the_hand_by_what_was_asked():
    before = ARM.position(REST)
    assert np.linalg.norm(before - REST_POSITION_M) < 1e-4
    # Damping 0.02 shortens a step in singular directions; near rest a tenth at the most.
    for step in EE_STEP_M * np.vstack((np.eye(3), -np.eye(3))):
        moved = ARM.position(ARM.displace(REST, before + step)) - before
        assert np.linalg.norm(moved - step) < 0.1 * EE_STEP_M, step


def test_a_step_stays_within_the_joints_limits_and_is_not_bent_by_them():
    for qpos in np.clip(POSES + 3.0, LOWER, UPPER):  # most joints at their upper limit
        moved = ARM.displace(qpos, np.array([3.0, -3.0, 3.0]))
        assert ((moved >= LOWER) & (moved <= UPPER)).all()
    # Upwards from rest with the shoulder's lift at its limit: the other joints make the step.
    qpos = np.array([REST[0], LOWER[1], *REST[2:]])
    goal = ARM.position(qpos) + np.array((0.0, 0.0, EE_STEP_M))
    after = ARM.displace(qpos, goal)
    assert ((after >= LOWER) & (after <= UPPER)).all()
    # Without the second solve the clipped joint's share is lost: 8 mm of the 15 upwards.
    assert np.linalg.norm(ARM.position(after) - goal) < 1e-3
