"""Point clouds from depth images (S App. D, SPA)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hab_spa.shapes import Array, invert_pose
from hab_tasks.constants import CAMERA_DEPTH_MAX_M
from hab_tasks.robots.cameras import camera_pose
from hab_tasks.robots.spec import RobotSpec

_SAPIEN_FROM_CAMERA = np.array(
    ((0.0, 0.0, 1.0, 0.0), (-1.0, 0.0, 0.0, 0.0), (0.0, -1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
)
"""SAPIEN's cameras look along x, with z up; depth images along z, with y down."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthView:
    """A depth image and its camera.

    Attributes:
        depth_m: (H, W) distance along the camera's axis; infinite beyond the range.
        focal_px: (2,) focal lengths, horizontal and vertical.
        centre_px: (2,) principal point; the corner of the first pixel is (0, 0).
        world_from_camera: (4, 4); camera x to the right, y down, z ahead.
    """

    depth_m: Array
    focal_px: Array
    centre_px: Array
    world_from_camera: Array

    @classmethod
    def read(cls, obs: Mapping[str, Any], camera: str, row: int) -> DepthView:
        """Reads a camera's depth image and pose of one row from an observation."""
        depth = np.asarray(obs["sensor_data"][camera]["depth"][row], dtype=float)[..., 0]
        parameters = obs["sensor_param"][camera]
        intrinsics = np.asarray(parameters["intrinsic_cv"][row], dtype=float)
        return cls(
            depth_m=np.where(depth < 1.0, depth * CAMERA_DEPTH_MAX_M, np.inf),
            focal_px=intrinsics[(0, 1), (0, 1)],
            centre_px=intrinsics[:2, 2],
            world_from_camera=world_from_camera(obs, camera, row),
        )

    @cached_property
    def points_m(self) -> Array:
        """World point (H, W, 3) at the centre of each pixel; NaN beyond the range."""
        depth_m = np.where(np.isfinite(self.depth_m), self.depth_m, np.nan)
        return self.to_world_m(self.rays() * depth_m[..., None])

    def rays(self) -> Array:
        """Returns the rays (H, W, 3) of the pixels' centres in the camera's frame, with z = 1."""
        height, width = self.depth_m.shape
        x = (np.arange(width) + 0.5 - self.centre_px[0]) / self.focal_px[0]
        y = (np.arange(height) + 0.5 - self.centre_px[1]) / self.focal_px[1]
        return np.stack((*np.meshgrid(x, y), np.ones((height, width))), axis=-1)

    def to_world_m(self, points_m: Array) -> Array:
        """Transforms points (..., 3) from the camera's frame to the world."""
        pose = self.world_from_camera
        return points_m @ pose[:3, :3].T + pose[:3, 3]

    def project(self, points_m: Array) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
        """Projects world points (K, 3) into the image.

        Returns:
            Indices of the points in the image (P,), their pixels (P, 2) as row and column, and
            their depths (P,).
        """
        camera_from_world = invert_pose(self.world_from_camera)
        x, y, depth_m = camera_from_world[:3, :3] @ points_m.T + camera_from_world[:3, 3:]
        height, width = self.depth_m.shape
        ahead_m = np.where(depth_m > 1e-3, depth_m, np.nan)  # NaN is outside every image
        columns = x / ahead_m * self.focal_px[0] + self.centre_px[0]
        rows = y / ahead_m * self.focal_px[1] + self.centre_px[1]
        inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
        which = np.flatnonzero(inside)
        pixels = np.stack((rows[which], columns[which]), axis=1).astype(np.int64)
        return which, pixels, depth_m[which]


def world_from_camera(obs: Mapping[str, Any], camera: str, row: int) -> Array:
    """Returns a camera's pose (4, 4): x to the right, y down, z ahead."""
    camera_from_world = np.eye(4)
    camera_from_world[:3] = np.asarray(obs["sensor_param"][camera]["extrinsic_cv"][row])
    return invert_pose(camera_from_world)


def world_from_base(robot: RobotSpec, obs: Mapping[str, Any], row: int) -> Array:
    """Returns the pose (4, 4) of the base frame, to which the head camera is fixed."""
    base_from_sapien = camera_pose(robot.cameras["head"]).to_transformation_matrix().astype(float)
    base_from_camera = base_from_sapien @ _SAPIEN_FROM_CAMERA
    return world_from_camera(obs, "head", row) @ invert_pose(base_from_camera)


def surface_points_m(
    view: DepthView, seen: NDArray[np.bool_], spacing_m: float, slope: float
) -> Array:
    """Returns a dense point cloud (K, 3) in the world, interpolated between pixels.

    The inverse depth of a plane is linear in the image, so it is interpolated between four
    neighbouring pixels of a surface.

    Args:
        view: The image.
        seen: (H, W) mask of the pixels to use.
        spacing_m: Maximum spacing of the points along an image row or column.
        slope: Neighbouring pixels are of different surfaces if their depths differ by more than
            this factor times their lateral distance.
    """
    depth_m, rays = view.depth_m, view.rays()
    corners = [np.s_[:-1, :-1], np.s_[:-1, 1:], np.s_[1:, :-1], np.s_[1:, 1:]]
    quads = np.stack([depth_m[corner] for corner in corners])
    whole = np.all([seen[corner] for corner in corners], axis=0)
    near_m, far_m = quads.min(axis=0), quads.max(axis=0)
    pixel_m = near_m / view.focal_px.min()
    with np.errstate(invalid="ignore"):
        whole &= far_m - near_m <= slope * pixel_m
    inverse = 1.0 / quads[:, whole]
    directions = np.stack([rays[corner][whole] for corner in corners])
    counts = np.ceil((pixel_m[whole] + far_m[whole] - near_m[whole]) / spacing_m).astype(int)
    points = [rays[seen] * depth_m[seen, None]]
    for count in np.unique(counts):
        steps = (np.arange(count) + 0.5) / count
        x, y = (grid.reshape(-1, 1) for grid in np.meshgrid(steps, steps))
        weights = np.hstack(((1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y))  # (C, 4)
        chosen = counts == count
        depth = 1.0 / (weights @ inverse[:, chosen])
        direction = np.tensordot(weights, directions[:, chosen], axes=1)
        points.append((direction * depth[..., None]).reshape(-1, 3))
    return view.to_world_m(np.concatenate(points))
