"""Action layout of the control modes: sizes, cells and bounds of the entries."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from hab_tasks.robots.spec import RobotSpec

ArmMode = Literal["ee", "joint_delta", "joint_target", "joint_state", "still"]
BaseMode = Literal["still", "velocity", "discrete", "pose"]

Bounds = NDArray[np.float32]

BASE_SIZE: dict[str, int] = {"still": 0, "velocity": 2, "discrete": 2, "pose": 3}

ABSOLUTE_ARM = ("joint_target", "joint_state")
"""Arm modes whose entries are joint positions [rad]."""

ARM_MODES = ("ee", "joint_delta", "joint_target", "joint_state")
"""Control modes of skills with a fixed base."""

MOBILE_MODES = (
    "ee_base",
    "joint_delta_base",
    "joint_target_base",
    "joint_state_base",
    "joint_target_pose",
    "joint_state_pose",
)
"""Control modes of skills and tasks that move arm and base."""

BASE_CELLS = tuple(
    (linear, angular) for linear in (-0.5, 0.0, 0.5, 1.0) for angular in (-1.0, -0.5, 0.0, 0.5, 1.0)
)
"""Forward and turning velocity of the discrete actions, as shares of the maximum (S H.2)."""

STOP_CELL = BASE_CELLS.index((0.0, 0.0))

STOP_SHARE = 0.05
"""Maximum absolute base entries of the stop action."""

WORLD_LIMIT_M = 20.0
"""Limit of base poses in x and y, which is the limit of Fetch's base joints."""


class Cells(spaces.Discrete):
    """Discrete action space that samples Python integers, which ManiSkill's recorder requires."""

    def sample(self, mask: Any = None, probability: Any = None) -> int:  # type: ignore[override]
        """Samples an action; see `gymnasium.spaces.Discrete.sample`."""
        return int(super().sample(mask, probability))


def arm_size(robot: RobotSpec, arm: ArmMode) -> int:
    """Returns the number of entries of the arm, without the gripper."""
    return {"ee": 3, "still": 0}.get(arm, len(robot.arm_joints))


def action_size(robot: RobotSpec, arm: ArmMode, base: BaseMode) -> int:
    """Returns the number of entries: arm and gripper, base."""
    return (arm_size(robot, arm) + 1 if arm != "still" else 0) + BASE_SIZE[base]


def action_bounds(robot: RobotSpec, arm: ArmMode, base: BaseMode) -> tuple[Bounds, Bounds]:
    """Returns the lower and upper bound of every entry, (A,) float32 each."""
    size, joints = action_size(robot, arm, base), len(robot.arm_joints)
    low, high = -np.ones(size, dtype=np.float32), np.ones(size, dtype=np.float32)
    if arm in ABSOLUTE_ARM:
        low[:joints], high[:joints] = robot.arm_lower_rad, robot.arm_upper_rad
    if base == "pose":
        high[-3:] = WORLD_LIMIT_M, WORLD_LIMIT_M, math.pi
        low[-3:] = -high[-3:]
    return low, high


def action_space(robot: RobotSpec, arm: ArmMode, base: BaseMode) -> spaces.Space[Any]:
    """Returns the space of the actions: of cells in a discrete mode, else of their entries."""
    if base == "discrete":
        return Cells(len(BASE_CELLS))
    low, high = action_bounds(robot, arm, base)
    return spaces.Box(low, high, dtype=np.float32)


def nearest_mode(name: object, modes: Sequence[str]) -> str | None:
    """Returns the mode that does most nearly what a control mode of ManiSkill does.

    None unless the name is one of ManiSkill's, ``pd_...``.
    """
    if not isinstance(name, str) or not name.startswith("pd_"):
        return None
    kind = "joint_target" if name.startswith("pd_joint_pos") else "joint_delta"
    kind = "ee" if "_ee_" in name else kind
    return next((mode for mode in modes if mode.startswith(kind)), modes[-1])


def within_a_turn(yaw_rad: Any) -> Any:
    """Wraps angles [rad], numbers or arrays, to [-pi, pi)."""
    return (yaw_rad + math.pi) % (2 * math.pi) - math.pi
