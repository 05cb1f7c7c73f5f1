"""Sets robot joint states directly: the perfect controller, and base poses.

A planner's arm can be set to each waypoint of its path instead of being driven there ("perfect
controller", S D and I.1), and a base pose can be set instead of navigating. Joints get to the end
of an action in equal shares, one before each physics step, so what is in between is touched.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from mani_skill.utils.structs import Articulation, ArticulationJoint
from numpy.typing import NDArray
from torch import Tensor

from hab_tasks.constants import CONTROL_HZ
from hab_tasks.robots.control_modes import within_a_turn
from hab_tasks.robots.robot import ROBOT
from hab_tasks.simulator import sapien_object

BLOCKED_DEPTH_M = 0.01
"""Depth in another body at which joints that are set directly stop."""

_BASE_STEP_M = ROBOT.base_linear_speed_m_s / CONTROL_HZ
_BASE_STEP_RAD = ROBOT.base_angular_speed_rad_s / CONTROL_HZ


class JointSetter:
    """Sets some of a robot's joints; the others are unaffected. CPU simulation only."""

    def __init__(
        self, robot: Articulation, joints: Sequence[ArticulationJoint], index: Tensor
    ) -> None:
        """Sets `joints`, which have the indices `index` (J,) among the active joints."""
        self._cpu_robot, self._columns = sapien_object(robot), index.tolist()
        self._cpu_drives = [sapien_object(joint).set_drive_target for joint in joints]
        self._start = self._way = np.zeros(len(joints))

    def values(self) -> NDArray[np.float32]:
        """Returns the joints' positions (J,)."""
        return self._cpu_robot.qpos[self._columns]

    def begin(self, way: NDArray[np.float64]) -> None:
        """Starts an action that moves the joints by `way` (J,)."""
        self._start, self._way = self.values().astype(np.float64), way

    def move(self, share: float) -> None:
        """Sets the joints, at rest, after a share of the way."""
        values = self._start + share * self._way
        positions, speeds = self._cpu_robot.qpos, self._cpu_robot.qvel
        positions[self._columns], speeds[self._columns] = values, 0.0
        self._cpu_robot.set_qpos(positions)
        self._cpu_robot.set_qvel(speeds)
        for drive, value in zip(self._cpu_drives, values.tolist(), strict=True):
            drive(value)


def base_way(base: NDArray[np.float32], goal: NDArray[np.float32]) -> NDArray[np.float64]:
    """Returns the displacement (3,) towards a base pose that the base's speeds allow."""
    way = np.subtract(goal, base, dtype=np.float64)
    way[2] = min(max(within_a_turn(way[2]), -_BASE_STEP_RAD), _BASE_STEP_RAD)
    way[:2] *= min(1.0, _BASE_STEP_M / max(math.hypot(way[0], way[1]), 1e-9))
    return way
