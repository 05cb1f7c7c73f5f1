"""What is shut in, behind a door or in a drawer, cannot be grasped (S H.1: pick needs is_open)."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from mani_skill.utils.structs import Link
from torch import Tensor

from hab_tasks.fronts import FrontKind
from hab_tasks.robots.grasp import Handle, SnapGrasp
from hab_tasks.scenes.floor import body_points
from hab_tasks.scenes.shapes import read_body


class Containers:
    """The closed furniture of one batch."""

    def __init__(self, kinds: tuple[FrontKind, ...], grasp: SnapGrasp) -> None:
        """Watches one door or drawer of each kind, those with the kind's marker."""
        self._grasp = grasp
        named = {handle.name: handle for handle in grasp.handles}
        self._containers = [
            _Container(kind, named[kind.marker]) for kind in kinds if kind.marker in named
        ]

    def shut_in(self) -> Tensor | None:
        """Returns which of the grasp's objects (N, K) are shut in; None if nothing is closed."""
        closed = [(c, c.closed()) for c in self._containers]
        closed = [(c, rows) for c, rows in closed if bool(rows.any())]
        if not closed:
            return None
        points = self._grasp.objects_com_m()
        shut = torch.zeros(points.shape[:2], dtype=torch.bool, device=points.device)
        for container, rows in closed:
            shut |= container.holds(points) & rows[:, None]
        return shut


class _Container:
    """A drawer, or the body behind a door, as a box in its link's frame."""

    def __init__(self, kind: FrontKind, handle: Handle) -> None:
        self._kind, self._handle = kind, handle
        joint: Any = handle.link.joint
        # A drawer holds its things itself; a door closes the body that it hangs on.
        link = handle.link if joint.type[0] == "prismatic" else _parent(handle)
        self._link = link
        shapes = read_body(link.name, "furniture", link._objs[0]).shapes
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
    parent = joint._objs[0].parent_link
    return next(link for link in handle.furniture.links if link._objs[0] == parent)
