"""Exact answers for pairs of shapes, by coal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import coal  # pyright: ignore[reportMissingImports]  # compiled, no stubs
import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]  # compiled, no stubs
from numpy.typing import NDArray

from hab_spa.shapes import Array
from hab_tasks.privileged import CollisionBody
from hab_tasks.world.scenes.coal_shapes import CoalShape, coal_shape

_shapes: WeakKeyDictionary[CollisionBody, list[CoalShape]] = WeakKeyDictionary()


def coal_shapes(body: CollisionBody) -> list[CoalShape]:
    """Returns the coal shapes of a body, in order; made once, shared by all scenes with it."""
    if body not in _shapes:
        _shapes[body] = [coal_shape(shape) for shape in body.shapes]
    return _shapes[body]


@dataclass(frozen=True, kw_only=True)
class Contact:
    """Two shapes closer than their margin; `distance_m` is negative when they penetrate."""

    pair: int
    first: str
    second: str
    distance_m: float


class CoalModel:
    """The shapes of a collision model, with their current poses in their joints' frames."""

    def __init__(
        self, model: pin.Model, shapes: Sequence[CoalShape], joints: NDArray[np.int64], poses: Array
    ) -> None:
        """Takes the shapes of an arm.

        Args:
            model: The arm.
            shapes: N shapes.
            joints: (N,) the joint that each moves with; 0 for the root.
            poses: (N, 4, 4) their poses in the joints' frames; not copied.
        """
        self._model, self._data = model, model.createData()
        self._shapes, self._joints, self._poses = shapes, joints.tolist(), poses
        self._request = coal.CollisionRequest(coal.CollisionRequestFlag.NO_REQUEST, 1)

    def collides(self, qpos: Array, first: int, second: int, margin_m: float) -> bool:
        """Whether two shapes are closer than a margin at an arm pose (7,) [rad]."""
        pin.forwardKinematics(self._model, self._data, qpos)
        self._request.security_margin = margin_m
        self._request.distance_upper_bound = margin_m + 1e-6  # as Pinocchio does
        placed = (*self._placed(first), *self._placed(second))
        return coal.collide(*placed, self._request, coal.CollisionResult()) > 0

    def distance_m(self, qpos: Array, first: int, second: int) -> float:
        """Returns the distance of two shapes; negative when they penetrate."""
        pin.forwardKinematics(self._model, self._data, qpos)
        placed = (*self._placed(first), *self._placed(second))
        return coal.distance(*placed, coal.DistanceRequest(), coal.DistanceResult())

    def _placed(self, number: int) -> tuple[coal.CollisionGeometry, coal.Transform3s]:
        geometry, offset = self._shapes[number]
        pose = self._data.oMi[self._joints[number]] * pin.SE3(self._poses[number] @ offset)
        return geometry, coal.Transform3s(pose.rotation, pose.translation)
