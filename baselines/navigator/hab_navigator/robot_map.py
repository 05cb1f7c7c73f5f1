"""The map that a navigating robot draws of what it has seen.

Nothing is learned here. Only what a policy observes and does enters: depth images, the point to go
to, and its own actions. These give the robot's turns; its position follows from the point, which
does not move. A base that touches something turns by less or more than it wants to; how far, the
image tells (`match_shares`). In a task, whose observation has several points that do not move, the
pose of the base is known.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hab_tasks.constants import CAMERA_DEPTH_MAX_M, CAMERA_HFOV_RAD, CONTROL_HZ
from hab_tasks.privileged import Array
from hab_tasks.robots.cameras import camera_pose
from hab_tasks.robots.control_modes import BASE_CELLS
from hab_tasks.robots.spec import CameraPlace, RobotSpec

OBSTACLE_M = 0.15
"""Height from which a surface counts as an obstacle."""

NEAR_M = 6.0
"""Farther surfaces are not matched."""

MOST_POINTS = 600
LEAST_POINTS = 50
"""With fewer points nothing is matched."""

BLUR_CELLS = 1.0
"""Standard deviation of the blur of the map's obstacles."""

AROUND_CELLS = 70
"""The map is matched so far around the base; no cell beyond is needed for `NEAR_M`."""


def match_shares(
    obstacles: NDArray[np.bool_],
    points_m: Array,
    poses: Array,
    here: NDArray[np.intp],
    cell_m: float,
) -> Array:
    """Returns how well points fit the map's obstacles from each pose, (K,) shares.

    Args:
        obstacles: (C, C) cells with obstacles; the map's origin is in the middle.
        points_m: (P, 2) obstacles that are seen, in the base frame.
        poses: (K, 3) candidates, x, y [m] and yaw [rad].
        here: (2,) the cell of the base, roughly.
        cell_m: Side of a cell.
    """
    if len(points_m) < LEAST_POINTS:
        return np.zeros(len(poses))
    points_m = points_m[:: 1 + len(points_m) // MOST_POINTS]
    first = np.maximum(here - AROUND_CELLS, 0)
    last = here + AROUND_CELLS
    near = obstacles[first[0] : last[0], first[1] : last[1]].astype(np.float32)
    blurred = ndimage.gaussian_filter(near, BLUR_CELLS)
    cosine, sine = np.cos(poses[:, 2, None]), np.sin(poses[:, 2, None])
    x = poses[:, 0, None] + cosine * points_m[:, 0] - sine * points_m[:, 1]
    y = poses[:, 1, None] + sine * points_m[:, 0] + cosine * points_m[:, 1]
    cells = np.stack((x.ravel(), y.ravel())) / cell_m + len(obstacles) // 2 - 0.5
    found = ndimage.map_coordinates(blurred, cells - first[:, None], order=1, mode="constant")
    return found.reshape(x.shape).mean(axis=1)


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

GONE_M, GONE_WITHIN_M, GONE_HEIGHTS = 0.3, 3.0, 8
"""An obstacle is gone if the image shows surfaces so far behind it at all of so many heights that
are in view. Obstacles beyond the second distance are not looked through."""

LEAST_HEIGHTS = 3
"""At so many of the heights it has to be in view."""

AS_WANTED_M = (0.01, 0.03)
"""A base that has moved as its action wants is so near to there, to the side and ahead."""

SPAN_RAD, STEP_RAD = 0.08, 0.01
"""A base that has not may have turned so much less or more; the yaws tried lie so far apart."""

SIDEWAYS_COST_PER_M, BEYOND_COST_PER_M = 0.3, 0.6
"""What a pose has to match better for the base to have been pushed sideways, or along its heading
by more than the action wants."""


class RobotMap:
    """A map in the frame of the first base pose.

    Attributes:
        pose: (3,) x, y [m] and yaw [rad] of the base.
        point_m: (2,) the point to go to.
        tops: (C, C) height of what is in each cell, in 1/255 of `HIGHEST_M`.
        seen: (C, C) what is known of each cell.
    """

    def __init__(self, robot: RobotSpec, repeat: int) -> None:
        """Creates an empty map for actions that a robot executes `repeat` times."""
        self._camera = robot.cameras["head"]
        self._turn_rad = robot.base_angular_speed_rad_s * repeat / CONTROL_HZ
        self._ahead_m = robot.base_linear_speed_m_s * repeat / CONTROL_HZ
        self._wanted, self._has_point = np.zeros(2), False  # m ahead and rad
        self._origin: Array | None = None
        self.pose, self.point_m = np.zeros(3), np.zeros(2)
        self.tops: Bytes = np.zeros((CELLS, CELLS), dtype=np.uint8)
        self.seen: Bytes = np.zeros((CELLS, CELLS), dtype=np.uint8)

    def take(self, action: int) -> None:
        """Takes an action into account, a cell of ``base_discrete``."""
        self._wanted = np.array((self._ahead_m, self._turn_rad)) * BASE_CELLS[action]

    def forget_point(self) -> None:
        """Takes the point of the next look as the one to go to."""
        self._has_point = False

    def look(self, depth: Array, point_in_base_m: Array, base: Array | None = None) -> Array:
        """Draws what is seen; returns its points (P, 3) in the map's frame.

        Args:
            depth: (H, W, 1) depth image of the head camera as shares of its range.
            point_in_base_m: (3,) the point to go to.
            base: (3,) x, y [m] and yaw [rad] of the base in any frame that stays the same; None if
                it is not known. Needed to look for another point than at first.
        """
        points_m, distances_m = surfaces(np.asarray(depth), self._camera, RAYS_PX)
        point_m = np.asarray(point_in_base_m[:2], dtype=float)
        if base is not None:
            self._stand(base)
            self._forget_gone(np.asarray(depth))
        elif self._has_point:
            matched = (points_m[:, 2] > OBSTACLE_M) & (distances_m < NEAR_M)
            self._move(point_m, points_m[matched, :2])
        if not self._has_point:
            self._has_point, self.point_m = True, self.pose[:2] + turned(point_m, self.pose[2])
        self._wanted = np.zeros(2)
        is_floor = points_m[:, 2] < FLOOR_M + FLOOR_RISE * distances_m
        points_m[:, :2] = turned(points_m[:, :2], self.pose[2]) + self.pose[:2]
        cells = cells_of(points_m[:, :2])
        heights = np.where(is_floor, 0.0, 255.0 * points_m[:, 2] / HIGHEST_M)
        flat = cells[:, 0] * CELLS + cells[:, 1]
        np.maximum.at(self.tops.reshape(-1), flat, heights.astype(np.uint8))
        seen = self.seen.reshape(-1)
        seen[flat] = np.maximum(seen[flat], SEEN)
        self.seen[tuple(cells_of(self.pose[:2]))] = VISITED
        return points_m

    def _forget_gone(self, depth: Array) -> None:
        """Removes obstacles through which the image shows what is behind: doors move, and arms."""
        x, y = cells_of(self.pose[:2])
        low = np.maximum((x, y) - np.array(int(GONE_WITHIN_M / CELL_M)), 0)
        near = self.tops[low[0] : 2 * x - low[0], low[1] : 2 * y - low[1]]
        cells = np.argwhere(near > 255 * OBSTACLE_M / HIGHEST_M) + low
        tops_m = HIGHEST_M / 255 * self.tops[tuple(cells.T)]
        shares = (np.arange(GONE_HEIGHTS) + 0.5) / GONE_HEIGHTS
        heights_m = OBSTACLE_M + (tops_m - OBSTACLE_M)[:, None] * shares
        in_map_m = CELL_M * (cells - CELLS // 2 + 0.5)
        level_m = turned(in_map_m - self.pose[:2], -self.pose[2])
        level_m = np.broadcast_to(level_m[:, None], (*heights_m.shape, 2))
        behind_m = behind(depth, self._camera, np.dstack((level_m, heights_m)))
        seen = np.isfinite(behind_m)
        through = (seen.sum(axis=1) >= LEAST_HEIGHTS) & (~seen | (behind_m > GONE_M)).all(axis=1)
        self.tops[tuple(cells[through].T)] = 0

    def _stand(self, base: Array) -> None:
        """Sets the pose; the first one is the origin of the map."""
        if self._origin is None:
            self._origin = np.array(base, dtype=float)
        moved = np.asarray(base, dtype=float) - self._origin
        self.pose = np.append(turned(moved[:2], -self._origin[2]), moved[2])

    def _move(self, point_in_base_m: NDArray[Any], obstacles_m: NDArray[Any]) -> None:
        """Updates the pose by the point (2,) and obstacles (P, 2) in the frame of the base."""
        ahead_m, turn_rad = self._wanted
        wanted = self._poses(point_in_base_m, np.array([turn_rad]))
        moved_m, sideways_m = _moved(self.pose, wanted)
        if abs(sideways_m[0]) < AS_WANTED_M[0] and abs(moved_m[0] - ahead_m) < AS_WANTED_M[1]:
            self.pose = wanted[0]
            return
        low_rad, high_rad = min(0.0, turn_rad) - SPAN_RAD, max(0.0, turn_rad) + SPAN_RAD
        poses = self._poses(point_in_base_m, np.arange(low_rad, high_rad, STEP_RAD))
        moved_m, sideways_m = _moved(self.pose, poses)
        beyond_m = np.abs(moved_m - np.clip(moved_m, min(0.0, ahead_m), max(0.0, ahead_m)))
        walls = self.tops > 255 * OBSTACLE_M / HIGHEST_M
        here = cells_of(self.pose[:2])
        score = match_shares(walls, obstacles_m, poses, here, CELL_M)
        score -= SIDEWAYS_COST_PER_M * np.abs(sideways_m) + BEYOND_COST_PER_M * beyond_m
        self.pose = poses[int(score.argmax())]

    def _poses(self, point_in_base_m: NDArray[Any], turns_rad: NDArray[Any]) -> NDArray[Any]:
        """Returns the poses (K, 3) after turns (K,) in which the point (2,) is where it is seen."""
        yaws_rad = self.pose[2] + turns_rad
        seen_m = np.broadcast_to(point_in_base_m, (len(yaws_rad), 2))
        return np.column_stack((self.point_m - turned(seen_m, yaws_rad), yaws_rad))


def _moved(before: NDArray[Any], poses: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Returns how far a base (3,) has moved to be at poses (K, 3), ahead and to the side (K,)."""
    heading_rad = (before[2] + poses[:, 2]) / 2
    moved_m = turned(poses[:, :2] - before[:2], -heading_rad)
    return moved_m[:, 0], moved_m[:, 1]


def turned(points_m: NDArray[Any], yaw_rad: NDArray[Any] | float) -> NDArray[Any]:
    """Returns points (..., 2) turned by angles (...)."""
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    x, y = points_m[..., 0], points_m[..., 1]
    return np.stack((cosine * x - sine * y, sine * x + cosine * y), axis=-1)


def cells_of(points_m: NDArray[Any]) -> NDArray[np.intp]:
    """Returns the cells (..., 2) of points (..., 2); beyond the map, those at its edge."""
    cells = np.floor(np.asarray(points_m) / CELL_M).astype(np.intp) + CELLS // 2
    return np.clip(cells, 0, CELLS - 1)


def surfaces(depth: Array, camera: CameraPlace, rays_px: int) -> tuple[Array, Array]:
    """Returns the surfaces in an image (P, 3) in the base frame, and their depths (P,) [m].

    Args:
        depth: (H, W, 1) depth image of the head camera as shares of its range.
        camera: That camera.
        rays_px: Rows and columns of the image that are used.
    """
    stride = depth.shape[0] // rays_px
    first = stride // 2
    distances_m = CAMERA_DEPTH_MAX_M * depth[first::stride, first::stride, 0]
    camera_m = np.array(camera.position_m, dtype=np.float32)
    in_base_m = distances_m[..., None] * _rays(camera, rays_px) + camera_m
    # 0 where nothing is seen within the range.
    kept = (distances_m > 0.0) & (distances_m < 0.99 * CAMERA_DEPTH_MAX_M)
    kept &= in_base_m[..., 2] < HIGHEST_M
    arm = np.ones_like(kept)
    for axis, (low_m, high_m) in enumerate(ARM_M):
        arm &= (in_base_m[..., axis] > low_m) & (in_base_m[..., axis] < high_m)
    kept &= ~arm
    return in_base_m[kept], distances_m[kept]


def behind(depth: Array, camera: CameraPlace, points_m: Array) -> Array:
    """Returns how far (...) behind points (..., 3) in the base frame an image shows something.

    Args:
        depth: (H, W, 1) depth image of the head camera as shares of its range.
        camera: That camera.
        points_m: The points.

    Returns:
        Metres along the camera's axis; NaN outside the image.
    """
    pose = camera_pose(camera).to_transformation_matrix()
    ahead_m, left_m, up_m = np.moveaxis((points_m - pose[:3, 3]) @ pose[:3, :3], -1, 0)
    ahead_m = np.where(ahead_m > 0.0, ahead_m, np.nan)
    slopes = np.stack((-up_m, -left_m)) / ahead_m / np.tan(CAMERA_HFOV_RAD / 2)
    inside = (np.abs(slopes) < 1.0).all(axis=0)
    rows, columns = ((slopes[:, inside] + 1.0) / 2 * len(depth)).astype(np.intp)
    found_m = np.full(ahead_m.shape, np.nan)
    found_m[inside] = CAMERA_DEPTH_MAX_M * depth[rows, columns, 0] - ahead_m[inside]
    return found_m


@cache
def _rays(camera: CameraPlace, rays_px: int) -> Array:
    """Returns the rays through the pixels (P, P, 3) in the base frame; x forward, y left."""
    slopes = np.tan(CAMERA_HFOV_RAD / 2) * (2 * (np.arange(rays_px) + 0.5) / rays_px - 1)
    right, down = np.meshgrid(slopes, slopes)
    in_camera = np.stack((np.ones_like(right), -right, -down), axis=-1)  # SAPIEN's axes
    rotation = camera_pose(camera).to_transformation_matrix()[:3, :3]
    return (in_camera @ rotation.T).astype(float)
