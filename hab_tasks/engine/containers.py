"""Objects in closed containers cannot be grasped (S H.1: pick requires is_open)."""

from __future__ import annotations

from typing import Any

import numpy as np

from hab_tasks.arrays import Bools, Floats
from hab_tasks.articulations import ArticulationKind
from hab_tasks.robots.grasp import SnapGrasp
from hab_tasks.robots.handle import Handle
from hab_tasks.simulator import sapien_object
from hab_tasks.world.scenes.floor import body_points
from hab_tasks.world.scenes.shapes import read_body


class Containers:
    """Containers that can be closed: drawers, and bodies with a door."""

    def __init__(self, kinds: tuple[ArticulationKind, ...], grasp: SnapGrasp) -> None:
        """Uses one door or drawer of each kind: the one with the kind's handle marker."""
        self._grasp = grasp
        named = {handle.name: handle for handle in grasp.handles}
        self._containers = [
            _Container(kind, named[kind.marker]) for kind in kinds if kind.marker in named
        ]

    def is_enclosed(self) -> Bools | None:
        """Returns which objects of the grasp (K,) are enclosed; None if nothing is closed."""
        closed = [container for container in self._containers if container.is_closed()]
        if not closed:
            return None
        points_m = self._grasp.objects_com_m()
        return np.any([container.holds(points_m) for container in closed], axis=0)


class _Container:
    """Bounding box of a drawer, or of the body behind a door, in its link's frame."""

    def __init__(self, kind: ArticulationKind, handle: Handle) -> None:
        self._kind, self._column = kind, handle.column
        self._furniture: Any = sapien_object(handle.furniture)
        link: Any = sapien_object(handle.link)
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
