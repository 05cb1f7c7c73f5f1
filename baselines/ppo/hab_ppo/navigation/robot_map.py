"""The map that a navigating robot draws of what it has seen.

Nothing is learned here. Only what a policy observes and does enters: depth images, the point to go
to, and its own actions. These give the robot's turns; its position follows from the point, which
does not move. A blocked base turns by less than it wants to: by as much as lets it move along its
heading.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hab_tasks.constants import CAMERA_DEPTH_MAX_M, CAMERA_HFOV_RAD, CONTROL_HZ
from hab_tasks.privileged import Array
from hab_tasks.robots.cameras import PLACES
from hab_tasks.robots.control_modes import BASE_CELLS
from hab_tasks.robots.robot import ROBOT

Bytes = NDArray[np.uint8]

CELL_M = 0.1
CELLS = 256
"""Side of a cell, and number of cells along the map's sides; the first pose is in the middle."""

HIGHEST_M = 1.8
"""Anything above, such as a ceiling, is left out."""

FLOOR_M, FLOOR_RISE = 0.05, 0.015
"""Up to this height a surface counts as floor, and up to so much more for each metre of distance
from the camera: far surfaces are seen less exactly."""

SEEN, VISITED = 1, 2
"""What has been seen, and where the base was; 0 where nothing has been seen yet."""

RAYS_PX = 64
"""Rows and columns of the depth image that are drawn."""

ARM_M = ((0.0, 1.0), (-0.35, 0.35), (0.5, 1.5))
"""Box in the base frame around the resting arm and what it holds, which are not drawn."""

TURN_SHARES = np.linspace(1.0, 0.0, 9)
"""Shares of a commanded turn that a blocked base may have made."""

SLIP_M = 0.05
"""The share is 0 instead of 1 if that explains so much sideways motion."""


class RobotMap:
    """A map in the frame of the first base pose.

    Attributes:
        pose: (3,) x, y [m] and yaw [rad] of the base.
        point_m: (2,) the point to go to.
        tops: (C, C) height of what is in each cell, in 1/255 of `HIGHEST_M`.
        seen: (C, C) what is known of each cell.
    """

    def __init__(self, repeat: int) -> None:
        """Creates an empty map for actions that are executed `repeat` times."""
        self._turn_rad = ROBOT.base_angular_speed_rad_s * repeat / CONTROL_HZ
        self._wanted_rad, self._is_empty = 0.0, True
        self.pose, self.point_m = np.zeros(3), np.zeros(2)
        self.tops: Bytes = np.zeros((CELLS, CELLS), dtype=np.uint8)
        self.seen: Bytes = np.zeros((CELLS, CELLS), dtype=np.uint8)

    def turn(self, action: int) -> None:
        """Takes an action into account, a cell of ``base_discrete``."""
        self._wanted_rad = self._turn_rad * BASE_CELLS[action][1]

    def look(self, depth: Array, point_in_base_m: Array) -> None:
        """Draws what is seen.

        Args:
            depth: (H, W, 1) depth image of the head camera as shares of its range.
            point_in_base_m: (3,) the point to go to.
        """
        if self._is_empty:
            self._is_empty, self.point_m = False, np.array(point_in_base_m[:2], dtype=float)
        self._move(np.asarray(point_in_base_m[:2], dtype=float))
        self._wanted_rad = 0.0
        points_m, distances_m = _surfaces(np.asarray(depth))
        is_floor = points_m[:, 2] < FLOOR_M + FLOOR_RISE * distances_m
        points_m[:, :2] = turned(points_m[:, :2], self.pose[2]) + self.pose[:2]
        cells = cells_of(points_m[:, :2])
        heights = np.where(is_floor, 0.0, 255.0 * points_m[:, 2] / HIGHEST_M)
        flat = cells[:, 0] * CELLS + cells[:, 1]
        np.maximum.at(self.tops.reshape(-1), flat, heights.astype(np.uint8))
        seen = self.seen.reshape(-1)
        seen[flat] = np.maximum(seen[flat], SEEN)
        self.seen[tuple(cells_of(self.pose[:2]))] = VISITED

    def _move(self, point_in_base_m: NDArray[Any]) -> None:
        """Updates the pose by the point (2,), in the frame of a base that has moved."""
        turns_rad = TURN_SHARES * self._wanted_rad  # (S,)
        yaws_rad = self.pose[2] + turns_rad
        places_m = self.point_m - turned(np.broadcast_to(point_in_base_m, (9, 2)), yaws_rad)
        moved_m = places_m - self.pose[:2]
        heading_rad = self.pose[2] + turns_rad / 2
        slip_m = np.cos(heading_rad) * moved_m[:, 1] - np.sin(heading_rad) * moved_m[:, 0]
        best = int((np.abs(slip_m) + SLIP_M * (1.0 - TURN_SHARES)).argmin())
        self.pose = np.array((*places_m[best], yaws_rad[best]))


def turned(points_m: NDArray[Any], yaw_rad: NDArray[Any] | float) -> NDArray[Any]:
    """Returns points (..., 2) turned by angles (...)."""
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    x, y = points_m[..., 0], points_m[..., 1]
    return np.stack((cosine * x - sine * y, sine * x + cosine * y), axis=-1)


def cells_of(points_m: NDArray[Any]) -> NDArray[np.intp]:
    """Returns the cells (..., 2) of points (..., 2); beyond the map, those at its edge."""
    cells = np.floor(np.asarray(points_m) / CELL_M).astype(np.intp) + CELLS // 2
    return np.clip(cells, 0, CELLS - 1)


def _surfaces(depth: Array) -> tuple[Array, Array]:
    """Returns the surfaces in an image (P, 3) in the base frame, and their depths (P,) [m]."""
    stride = depth.shape[0] // RAYS_PX
    first = stride // 2
    distances_m = CAMERA_DEPTH_MAX_M * depth[first::stride, first::stride, 0]
    in_base_m = distances_m[..., None] * _DIRECTIONS + _CAMERA_M
    # 0 where nothing is seen within the range.
    kept = (distances_m > 0.0) & (distances_m < 0.99 * CAMERA_DEPTH_MAX_M)
    kept &= in_base_m[..., 2] < HIGHEST_M
    arm = np.ones_like(kept)
    for axis, (low_m, high_m) in enumerate(ARM_M):
        arm &= (in_base_m[..., axis] > low_m) & (in_base_m[..., axis] < high_m)
    kept &= ~arm
    return in_base_m[kept], distances_m[kept]


def _rays() -> Array:
    """Returns the rays through the pixels (P, P, 3) in the base frame; x forward, y left."""
    slopes = np.tan(CAMERA_HFOV_RAD / 2) * (2 * (np.arange(RAYS_PX) + 0.5) / RAYS_PX - 1)
    right, down = np.meshgrid(slopes, slopes)
    in_camera = np.stack((np.ones_like(right), -right, -down), axis=-1)  # SAPIEN's axes
    rotation = PLACES["head"].pose().to_transformation_matrix()[:3, :3]
    return (in_camera @ rotation.T).astype(float)


_DIRECTIONS = _rays()
_CAMERA_M = np.array(PLACES["head"].position_m, dtype=np.float32)
