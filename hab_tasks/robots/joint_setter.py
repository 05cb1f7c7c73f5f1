"""Sets robot joint states directly: the perfect controller, and base poses.

A planner's arm can be set to each waypoint of its path instead of being driven there ("perfect
controller", S D and I.1), and a base pose can be set instead of navigating. Joints get to the end
of an action in equal shares, one before each physics step, so what is in between is touched.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hab_tasks.robots.control_modes import within_a_turn
from hab_tasks.robots.spec import RobotSpec

BLOCKED_DEPTH_M = 0.01
"""Depth in another body at which joints that are set directly stop."""


class JointSetter:
    """Sets some of a robot's joints; the others are unaffected."""

    def __init__(self, robot: Any, joints: Sequence[int]) -> None:
        """Sets the `joints` (J,) among the active joints of a SAPIEN articulation."""
        self._robot, self._columns = robot, list(joints)
        active = robot.active_joints
        self._drives = [active[column].set_drive_target for column in self._columns]
        self._start = self._way = np.zeros(len(self._columns))

    def values(self) -> NDArray[np.float32]:
        """Returns the joints' positions (J,)."""
        return self._robot.qpos[self._columns]

    def begin(self, way: NDArray[np.float64]) -> None:
        """Starts an action that moves the joints by `way` (J,)."""
        self._start, self._way = self.values().astype(np.float64), way

    def move(self, share: float) -> None:
        """Sets the joints, at rest, after a share of the way."""
        values = self._start + share * self._way
        positions, speeds = self._robot.qpos, self._robot.qvel
        positions[self._columns], speeds[self._columns] = values, 0.0
        self._robot.set_qpos(positions)
        self._robot.set_qvel(speeds)
        for drive, value in zip(self._drives, values.tolist(), strict=True):
            drive(value)


def base_way(
    robot: RobotSpec, base: NDArray[np.float32], goal: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Returns the displacement (3,) towards a base pose that the base's speeds allow."""
    step_m, step_rad = robot.base_step_m, robot.base_step_rad
    way = np.subtract(goal, base, dtype=np.float64)
    way[2] = min(max(within_a_turn(way[2]), -step_rad), step_rad)
    way[:2] *= min(1.0, step_m / max(math.hypot(way[0], way[1]), 1e-9))
    return way
