"""Bounding box of the held object (S App. D, SPA)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hab_spa.sensing.fitted_box import in_box
from hab_spa.shapes import Array
from hab_tasks.privileged import CollisionBody, CollisionShape

HELD = "held"
"""Name of the box's body."""


@dataclass(frozen=True, kw_only=True, eq=False)
class HeldBox:
    """A box of half size (3,), its pose (4, 4) in the end-effector's frame."""

    ee_from_box: Array
    half_size_m: Array

    @classmethod
    def around(cls, points_m: Array) -> HeldBox:
        """Returns the bounding box of points (K, 3), aligned with the end-effector's frame."""
        lower_m, upper_m = points_m.min(axis=0), points_m.max(axis=0)
        pose = np.eye(4)
        pose[:3, 3] = (lower_m + upper_m) / 2
        return cls(ee_from_box=pose, half_size_m=(upper_m - lower_m) / 2)

    def contains(
        self,
        points_m: Array,
        world_from_ee: Array,
        margin_m: float = 0.0,
        largest_m: float = np.inf,
    ) -> NDArray[np.bool_]:
        """Whether world points (K, 3) are inside the box.

        Args:
            points_m: The points.
            world_from_ee: Pose (4, 4) of the end-effector.
            margin_m: Enlargement of the box, ...
            largest_m: ... after limiting its half size to this.
        """
        half_m = np.minimum(self.half_size_m, largest_m) + margin_m
        return in_box(points_m, world_from_ee @ self.ee_from_box, half_m)

    def body(self, largest_m: float) -> CollisionBody:
        """Returns the box as a collision body, with its half size limited to `largest_m`."""
        box = CollisionShape(
            kind="box",
            body_from_shape=np.eye(4),
            half_size_m=np.minimum(self.half_size_m, largest_m),
            vertices_m=np.zeros((0, 3)),
            faces=np.zeros((0, 3), dtype=np.int64),
        )
        return CollisionBody(name=HELD, group="object", shapes=(box,))
