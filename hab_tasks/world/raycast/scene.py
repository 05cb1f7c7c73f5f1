"""Depth images of a set of bodies; a pure function of their poses and the camera's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import sapien
from numpy.typing import NDArray

from hab_tasks.geometry import Array
from hab_tasks.world.raycast.compiled import kernel
from hab_tasks.world.raycast.library import library
from hab_tasks.world.scenes.visuals import Visuals

CV_FROM_SAPIEN = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""SAPIEN's cameras look along x, with y to the left and z up."""


@dataclass(frozen=True, kw_only=True)
class Pinhole:
    """Intrinsic parameters of a camera.

    Attributes:
        width_px: Image width.
        height_px: Image height.
        focal_px: Focal lengths along width and height.
        centre_px: Principal point, from the image's left upper corner.
        near_m: Depth of the near plane; nothing nearer is seen.
        far_m: Depth of the far plane; nothing further is seen.
    """

    width_px: int
    height_px: int
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    near_m: float
    far_m: float

    @cached_property
    def lens(self) -> Any:
        """The camera as `kernel.Lens`."""
        slopes = [
            max(centre, size - centre) / focal
            for centre, size, focal in zip(
                self.centre_px, (self.width_px, self.height_px), self.focal_px, strict=True
            )
        ]
        values = (*self.focal_px, *self.centre_px, self.near_m, self.far_m, *slopes)
        return kernel().Lens(*(float(value) for value in values))


@dataclass(frozen=True, kw_only=True)
class RayBody:
    """A visible body: its name, its shapes, its entity, and whether its pose may change."""

    name: str
    visuals: Visuals
    entity: sapien.Entity
    moves: bool = True


class RayImage(NamedTuple):
    """One image.

    Attributes:
        depth_m: (H, W) float32 along the optical axis, 0 without a surface up to the far plane.
        actors: (H, W) int16 `per_scene_id` of the surface's entity, 0 without; (0, 0) if not
            requested.
    """

    depth_m: NDArray[np.float32]
    actors: NDArray[np.int16]


class RayScene:
    """Bodies that rays can hit."""

    def __init__(self, bodies: Sequence[RayBody]) -> None:
        """Reads the bodies' meshes; bodies without visuals are left out."""
        seen = [body for body in bodies if body.visuals]
        numbers = [(library().number(b.visuals), _actor(b.entity)) for b in seen]
        self._instances = np.array(numbers, dtype=np.int32).reshape(-1, 2)
        self._moving = [(row, body.entity) for row, body in enumerate(seen) if body.moves]
        self._world_from_body = np.zeros((len(seen), 4, 4))
        for row, body in enumerate(seen):
            self._world_from_body[row] = body.entity.pose.to_transformation_matrix()

    def update(self) -> None:
        """Reads the current poses of moving bodies."""
        poses = self._world_from_body
        for row, entity in self._moving:
            poses[row] = entity.pose.to_transformation_matrix()

    def image(self, camera: Pinhole, cv_from_world: Array, actors: bool = False) -> RayImage:
        """Casts a ray through the centre of every pixel, at the poses of the latest `update`.

        The frame of the camera in `cv_from_world` (4, 4) is x right, y down, z forward.
        """
        size = camera.height_px, camera.width_px
        furthest = np.float32(1.0 / camera.far_m)
        inverse = np.full(size, furthest, dtype=np.float32)
        numbers = np.zeros(size if actors else (0, 0), dtype=np.int16)
        poses = (cv_from_world @ self._world_from_body)[:, :3].astype(np.float32)
        instances, surfaces = self._instances, library().surfaces()
        kernel().cast(surfaces, instances, poses, camera.lens, inverse, numbers)
        depth_m = np.where(inverse > furthest, np.float32(1.0) / inverse, np.float32(0.0))
        return RayImage(depth_m, numbers)


def cv_from_world(world_from_camera: sapien.Pose) -> Array:
    """Returns the (4, 4) pose of the world in the frame of a SAPIEN camera, OpenCV axes."""
    matrix = np.eye(4)
    pose = world_from_camera.to_transformation_matrix().astype(np.float64)
    matrix[:3, :3] = CV_FROM_SAPIEN @ pose[:3, :3].T
    matrix[:3, 3] = -matrix[:3, :3] @ pose[:3, 3]
    return matrix


def _actor(entity: sapien.Entity) -> int:
    """Returns the actor number as in the renderer's 16-bit textures."""
    return int(np.array(entity.per_scene_id, dtype=np.uint32).astype(np.int16))
