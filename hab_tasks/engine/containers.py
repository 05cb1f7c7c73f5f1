"""Objects in closed containers cannot be grasped (S H.1: pick requires is_open)."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from mani_skill.utils.structs import Link
from torch import Tensor

from hab_tasks.articulations import ArticulationKind
from hab_tasks.robots.grasp import Handle, SnapGrasp
from hab_tasks.scenes.floor import body_points
from hab_tasks.scenes.shapes import read_body
from hab_tasks.simulator import sapien_object


class Containers:
    """Containers of one batch that can be closed: drawers, and bodies with a door."""

    def __init__(self, kinds: tuple[ArticulationKind, ...], grasp: SnapGrasp) -> None:
        """Uses one door or drawer of each kind: the one with the kind's handle marker."""
        self._grasp = grasp
        named = {handle.name: handle for handle in grasp.handles}
        self._containers = [
            _Container(kind, named[kind.marker]) for kind in kinds if kind.marker in named
        ]

    def is_enclosed(self) -> Tensor | None:
        """Returns which objects of the grasp (N, K) are enclosed; None if nothing is closed."""
        closed = [(c, c.closed()) for c in self._containers]
        closed = [(c, rows) for c, rows in closed if bool(rows.any())]
        if not closed:
            return None
        points = self._grasp.objects_com_m()
        enclosed = torch.zeros(points.shape[:2], dtype=torch.bool, device=points.device)
        for container, rows in closed:
            enclosed |= container.holds(points) & rows[:, None]
        return enclosed


class _Container:
    """Bounding box of a drawer, or of the body behind a door, in its link's frame."""

    def __init__(self, kind: ArticulationKind, handle: Handle) -> None:
        self._kind, self._handle = kind, handle
        joint: Any = handle.link.joint
        # A drawer is its own container; a door closes its parent link.
        link = handle.link if joint.type[0] == "prismatic" else _parent(handle)
        self._link = link
        shapes = read_body(link.name, "furniture", sapien_object(link)).shapes
        points = np.concatenate([body_points(shape)[:3].T for shape in shapes])
        device = link.device
        self._low_m = torch.as_tensor(points.min(axis=0), dtype=torch.float32, device=device)
        self._high_m = torch.as_tensor(points.max(axis=0), dtype=torch.float32, device=device)

    def closed(self) -> Tensor:
        """Whether it is closed, (N,) bool."""
        return self._kind.is_closed(self._handle.furniture.get_qpos()[:, self._handle.column])

    def holds(self, points_m: Tensor) -> Tensor:
        """Whether world points (N, K, 3) are inside, (N, K) bool."""
        link_from_world = self._link.pose.inv().to_transformation_matrix()
        rotation, offset = link_from_world[:, :3, :3], link_from_world[:, None, :3, 3]
        local = torch.matmul(points_m, rotation.transpose(1, 2)) + offset
        return ((local >= self._low_m) & (local <= self._high_m)).all(dim=2)


def _parent(handle: Handle) -> Link:
    joint: Any = handle.link.joint
    parent = sapien_object(joint).parent_link
    return next(link for link in handle.furniture.links if sapien_object(link) == parent)
