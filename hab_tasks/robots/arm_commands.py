"""The arm pose that an action commands."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hab_tasks.constants import EE_STEP_M, JOINT_STEP_RAD
from hab_tasks.robots.control_modes import ABSOLUTE_ARM, ArmMode
from hab_tasks.robots.kinematics import ArmKinematics
from hab_tasks.robots.robot import ROBOT

Array = NDArray[Any]

_EE_LOWER, _EE_UPPER = np.array(ROBOT.ee_lower_m), np.array(ROBOT.ee_upper_m)
_ARM_LOWER, _ARM_UPPER = np.array(ROBOT.arm_lower_rad), np.array(ROBOT.arm_upper_rad)


def commanded_arm(mode: ArmMode, qpos: Array, arm: Array, kinematics: ArmKinematics) -> Array:
    """Returns the commanded arm pose (7,) [rad] after an action.

    Args:
        mode: Meaning of the arm's entries, other than ``still``.
        qpos: (7,) arm pose commanded before [rad], float64.
        arm: Arm entries of the action, float32.
        kinematics: Kinematics of the arm.
    """
    if mode in ABSOLUTE_ARM:
        return arm
    if mode == "joint_delta":
        moved = qpos + JOINT_STEP_RAD * arm
        return np.minimum(np.maximum(moved, _ARM_LOWER), _ARM_UPPER)
    return kinematics.move(qpos, EE_STEP_M * arm, _EE_LOWER, _EE_UPPER)
