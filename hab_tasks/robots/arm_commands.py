"""The arm pose that an action commands."""

from __future__ import annotations

from functools import cache
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hab_tasks.constants import EE_STEP_M, JOINT_STEP_RAD, TARGET_STEP_RAD
from hab_tasks.robots.control_modes import ABSOLUTE_ARM, ArmMode
from hab_tasks.robots.kinematics import ArmKinematics
from hab_tasks.robots.spec import RobotSpec

Array = NDArray[Any]


def commanded_arm(mode: ArmMode, qpos: Array, arm: Array, kinematics: ArmKinematics) -> Array:
    """Returns the commanded arm pose (7,) [rad] after an action.

    Args:
        mode: Meaning of the arm's entries, other than ``still``.
        qpos: (7,) arm pose commanded before [rad], float64; ``joint_state``: its true pose.
        arm: Arm entries of the action, float32.
        kinematics: Kinematics of the arm.
    """
    if mode in ABSOLUTE_ARM:
        return np.minimum(np.maximum(arm, qpos - TARGET_STEP_RAD), qpos + TARGET_STEP_RAD)
    if mode == "joint_delta":
        moved = qpos + JOINT_STEP_RAD * arm
        return np.minimum(np.maximum(moved, kinematics.arm_lower_rad), kinematics.arm_upper_rad)
    return kinematics.move(qpos, EE_STEP_M * arm)


@cache
def ee_step_m(robot: RobotSpec, mode: ArmMode) -> float:
    """Returns the maximum displacement of the resting end-effector per action [m]."""
    if mode == "still":
        return 0.0
    if mode == "ee":
        return EE_STEP_M
    step_rad = JOINT_STEP_RAD if mode == "joint_delta" else TARGET_STEP_RAD
    _, jacobian = ArmKinematics(robot).position_and_jacobian(np.array(robot.rest_qpos_rad))
    corners = np.array(list(product((-1.0, 1.0), repeat=jacobian.shape[1])))
    return float(step_rad * np.linalg.norm(corners @ jacobian.T, axis=1).max())
