"""A handle of a door or drawer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mani_skill.utils.structs import Articulation, Link

from hab_tasks.simulator import sapien_object


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
