"""Nothing is grasped through furniture, or in closed containers (S H.1: pick requires is_open)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sapien.physx import PhysxRigidDynamicComponent

from hab_tasks.arrays import Bools, Floats
from hab_tasks.articulations import ArticulationKind
from hab_tasks.robots.handle import Handle
from hab_tasks.robots.mobile_manipulator import MobileManipulator
from hab_tasks.simulator import sapien_object
from hab_tasks.world.scenes.floor import body_points
from hab_tasks.world.scenes.pool import read_body

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


class Containers:
    """Containers that can be closed: drawers, and bodies with a door."""

    def __init__(
        self,
        kinds: tuple[ArticulationKind, ...],
        handles: Sequence[Handle],
        objects_com_m: Callable[[], Floats],
    ) -> None:
        """Uses one door or drawer of each kind: the one with the kind's handle marker."""
        self._objects_com_m = objects_com_m
        named = {handle.name: handle for handle in handles}
        self._containers = [
            _Container(kind, named[kind.marker]) for kind in kinds if kind.marker in named
        ]

    def is_enclosed(self) -> Bools | None:
        """Returns which graspable objects (K,) are enclosed; None if nothing is closed."""
        closed = [container for container in self._containers if container.is_closed()]
        if not closed:
            return None
        points_m = self._objects_com_m()
        return np.any([container.holds(points_m) for container in closed], axis=0)


class _Container:
    """Bounding box of a drawer, or of the body behind a door, in its link's frame."""

    def __init__(self, kind: ArticulationKind, handle: Handle) -> None:
        self._kind, self._column = kind, handle.column
        self._furniture, link = sapien_object(handle.furniture), handle.body
        # A drawer is its own container; a door closes its parent link.
        self._link = link if link.joint.type == "prismatic" else link.joint.parent_link
        shapes = read_body(self._link.name, "furniture", self._link).shapes
        points = np.concatenate([body_points(shape)[:3].T for shape in shapes])
        self._low_m, self._high_m = points.min(axis=0), points.max(axis=0)

    def is_closed(self) -> bool:
        """Whether it is closed."""
        return bool(self._kind.is_closed(self._furniture.qpos[self._column]))

    def holds(self, points_m: Floats) -> Bools:
        """Whether world points (K, 3) are inside, (K,) bool."""
        link_from_world = self._link.entity_pose.inv().to_transformation_matrix()
        local = points_m @ link_from_world[:3, :3].T + link_from_world[:3, 3]
        return ((local >= self._low_m) & (local <= self._high_m)).all(axis=1)
