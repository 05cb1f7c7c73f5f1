"""Nothing is grasped through furniture."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from sapien.physx import PhysxRigidDynamicComponent

from hab_tasks.robots.mobile_manipulator import MobileManipulator
from hab_tasks.simulator import sapien_object

FURNITURE_KG = 10.0
"""Movable bodies from this mass are furniture: tables and chairs."""


class LineOfSight:
    """Finds furniture between the hand and an object.

    The end-effector point is 5 cm beyond the fingers: pressed against a table, it is inside it, and
    what stands on the table is in reach from below.
    """

    def __init__(self, agent: MobileManipulator) -> None:
        """Looks from the hand of a robot, which blocks nothing."""
        self._px: Any = agent.scene.px
        self._robot = sapien_object(agent.ee_link).articulation

    def is_blocked(self, hand_m: NDArray[Any], object_m: NDArray[Any]) -> bool:
        """Whether furniture or a wall comes first on the way between two points (3,)."""
        way = np.subtract(object_m, hand_m, dtype=np.float32)
        length_m = float(np.linalg.norm(way))
        if length_m < 1e-6:
            return False
        hit = self._px.raycast(np.asarray(hand_m, dtype=np.float32), way / length_m, length_m)
        if hit is None:
            return False
        body = hit.component
        if isinstance(body, PhysxRigidDynamicComponent):
            return body.mass >= FURNITURE_KG
        return getattr(body, "articulation", None) != self._robot
