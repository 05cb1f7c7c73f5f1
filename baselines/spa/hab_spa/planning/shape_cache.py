"""Shapes of the simulator's bodies, prepared for collision models."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hab_spa.shapes import Array, box_distance_m, shape_bounds_m
from hab_tasks.privileged import CollisionBody, PrivilegedState
from hab_tasks.world.scenes.coal_shapes import CoalShape, coal_shape


@dataclass(frozen=True, kw_only=True, eq=False)
class _Boxes:
    """Bounding boxes of a body's shapes, each in the shape's frame.

    Attributes:
        body_from_shape: (S, 4, 4) poses of the shapes.
        lower_m: (S, 3) lower corners.
        upper_m: (S, 3) upper corners.
    """

    body_from_shape: Array
    lower_m: Array
    upper_m: Array


class ShapeCache:
    """Cache of shapes, valid until the scene's geometry changes."""

    def __init__(self) -> None:
        self._key: str | None = None
        self._shapes: dict[tuple[str, int], CoalShape] = {}
        self._boxes: dict[str, _Boxes] = {}

    def shapes(self, state: PrivilegedState, body: CollisionBody) -> list[CoalShape]:
        """Returns the coal shapes of a body of `state`, in order."""
        self._renew(state)
        for i, shape in enumerate(body.shapes):
            if (body.name, i) not in self._shapes:
                self._shapes[body.name, i] = coal_shape(shape)
        return [self._shapes[body.name, i] for i in range(len(body.shapes))]

    def within(
        self, state: PrivilegedState, body: CollisionBody, point_m: Array, reach_m: float
    ) -> NDArray[np.bool_]:
        """Whether the bounding box of each shape of a body of `state` is within reach: (S,).

        Args:
            state: The state.
            body: The body; it has shapes.
            point_m: (3,) the point to reach from, in the body's frame.
            reach_m: Maximum distance.
        """
        self._renew(state)
        if body.name not in self._boxes:
            lower_m, upper_m = zip(*map(shape_bounds_m, body.shapes), strict=True)
            self._boxes[body.name] = _Boxes(
                body_from_shape=np.stack([shape.body_from_shape for shape in body.shapes]),
                lower_m=np.stack(lower_m),
                upper_m=np.stack(upper_m),
            )
        boxes = self._boxes[body.name]
        gaps_m = point_m - boxes.body_from_shape[:, :3, 3]
        local_m = np.einsum("sji,sj->si", boxes.body_from_shape[:, :3, :3], gaps_m)
        return box_distance_m(local_m, boxes.lower_m, boxes.upper_m) < reach_m

    def _renew(self, state: PrivilegedState) -> None:
        if state.scene_key != self._key:
            self._key, self._shapes, self._boxes = state.scene_key, {}, {}
