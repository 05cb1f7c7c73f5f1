"""A handle of a door or drawer, and the point of the hand that grasps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import sapien
from mani_skill.utils.structs import Articulation, Link

from hab_tasks.robots.robot import ROBOT
from hab_tasks.simulator import sapien_object

EE_FROM_LINK = sapien.Pose([ROBOT.ee_offset_m, 0.0, 0.0])
"""Pose of the end-effector point in the frame of its link."""


@dataclass(frozen=True, kw_only=True)
class Handle:
    """A handle marker on a built piece of furniture."""

    name: str
    furniture_name: str
    furniture: Articulation
    link: Link
    offset_m: tuple[float, float, float]

    @property
    def column(self) -> int:
        """Index of the handle's joint in the furniture's active joints."""
        joint: Any = self.link.joint
        return int(joint.active_index[0])

    @property
    def limits(self) -> tuple[float, float]:
        """Limits of the handle's joint [m or rad]."""
        lower, upper = sapien_object(self.furniture).active_joints[self.column].limits[0].tolist()
        return lower, upper
