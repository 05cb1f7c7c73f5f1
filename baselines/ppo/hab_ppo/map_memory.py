"""Maps that a navigating robot draws of what it has seen: the memory of a policy without LSTM.

As in cognitive mapping and planning (arXiv 1702.03920), but nothing is learned in drawing. Only
what the policy observes and does enters: depth images, the point to go to, and its own actions.
These give the robot's turns; its position follows from the point, which does not move. A blocked
base turns by less than it wants to: by as much as lets it move along its heading. Maps are
forgotten where an episode starts.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hab_tasks.constants import CAMERA_DEPTH_MAX_M, CAMERA_HFOV_RAD, CONTROL_HZ
from hab_tasks.robots.cameras import PLACES
from hab_tasks.robots.control_modes import BASE_CELLS, STOP_CELL
from hab_tasks.robots.robot import ROBOT

Array = NDArray[np.float32]

SIDE_PX = 64
"""Width and height of the images of a map."""

HIGHEST_M = 1.8
"""Anything above, such as a ceiling, is left out."""

FLOOR_M = 0.05
"""Up to this height a surface counts as floor."""

SEEN, VISITED, STOPPED = 100, 180, 255
"""Values of the second channel: what has been seen, where the base was, and where it took the stop
action; 0 where nothing has been seen yet."""

STOP_MARK_M = 0.15
"""Stops are marked so far around, on maps with smaller cells."""

STOP_CELLS = ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))
"""The cells of a mark, from its middle."""

MARK_M = 0.3
"""Standard deviation of the mark at the point."""

RAYS_PX = 64
"""Rows and columns of the depth image that are drawn."""

ARM_M = ((0.0, 1.0), (-0.35, 0.35), (0.5, 1.5))
"""Box in the base frame around the resting arm and what it holds, which are not drawn."""

TURN_SHARES = np.linspace(1.0, 0.0, 9, dtype=np.float32)
"""Shares of a commanded turn that a blocked base may have made."""

SLIP_M = 0.05
"""The share is 0 instead of 1 if that explains so much sideways motion."""

_CELL_SHARES = np.array(BASE_CELLS, dtype=np.float32)


class Level(NamedTuple):
    """A resolution: side of a cell [m], and number of cells along the map's sides."""

    cell_m: float
    cells: int


LEVELS = (Level(0.1, 256), Level(0.25, 128))
CHANNELS = 3 * len(LEVELS)


class MapMemory:
    """Maps of N rows.

    Attributes:
        pose: (N, 3) x, y [m] and yaw [rad] of each base, in the frame of its first pose.
    """

    def __init__(self, rows: int, repeat: int) -> None:
        """Creates empty maps for actions that are executed `repeat` times."""
        self._turn_rad = ROBOT.base_angular_speed_rad_s * repeat / CONTROL_HZ
        self._wanted_rad = np.zeros(rows, dtype=np.float32)
        self.pose = np.zeros((rows, 3), dtype=np.float32)
        self._point_m = np.zeros((rows, 2), dtype=np.float32)
        # Height in 1/255 of HIGHEST_M, and what has been seen.
        self._grids = [
            np.zeros((rows, level.cells, level.cells, 2), dtype=np.uint8) for level in LEVELS
        ]
        self._fresh = np.ones(rows, dtype=bool)
        self._stopped = np.zeros(rows, dtype=bool)

    def forget(self, rows: NDArray[np.bool_]) -> None:
        """Empties the maps of the rows in a mask (N,)."""
        self._fresh |= rows

    def turn(self, actions: NDArray[np.integer[Any]]) -> None:
        """Takes the actions (N,) into account, cells of ``base_discrete``."""
        self._wanted_rad = self._turn_rad * _CELL_SHARES[actions, 1]
        self._stopped = np.asarray(actions) == STOP_CELL

    def look(self, depth: NDArray[Any], point_in_base_m: Array) -> NDArray[np.uint8]:
        """Draws what all rows see; returns the maps around the bases (N, H, W, C).

        The base is in the middle and looks up in the image. For each level there are a channel of
        heights, one of what has been seen and visited, and one with a mark at the point.

        Args:
            depth: (N, H, W, 1) depth images of the head camera as shares of their range.
            point_in_base_m: (N, 3) the point to go to.
        """
        fresh, self._fresh = self._fresh, np.zeros_like(self._fresh)
        for grid in self._grids:
            grid[fresh] = 0
        self.pose[fresh], self._wanted_rad[fresh], self._stopped[fresh] = 0.0, 0.0, False
        self._point_m[fresh] = point_in_base_m[fresh, :2]
        self._move(point_in_base_m[:, :2])
        self._wanted_rad = np.zeros_like(self._wanted_rad)
        rows, points_m = self._surfaces(depth)
        for level, grid in zip(LEVELS, self._grids, strict=True):
            _draw(level, grid, rows, points_m)
            self._mark(level, grid)
        self._stopped = np.zeros_like(self._stopped)
        return self._images(point_in_base_m)

    def _move(self, point_in_base_m: Array) -> None:
        """Updates the poses by the point (N, 2), in the frame of bases that have moved."""
        turns_rad = TURN_SHARES[:, None] * self._wanted_rad  # (S, N)
        yaws_rad = (self.pose[:, 2] + turns_rad).astype(np.float32)
        places_m = self._point_m - _turned(point_in_base_m[None], yaws_rad)
        moved_m = places_m - self.pose[:, :2]
        heading_rad = self.pose[:, 2] + turns_rad / 2
        slip_m = np.cos(heading_rad) * moved_m[..., 1] - np.sin(heading_rad) * moved_m[..., 0]
        cost = np.abs(slip_m) + SLIP_M * (1.0 - TURN_SHARES[:, None])
        best, rows = cost.argmin(axis=0), np.arange(len(self.pose))
        self.pose[:, 2] = yaws_rad[best, rows]
        self.pose[:, :2] = places_m[best, rows]

    def _mark(self, level: Level, grid: NDArray[np.uint8]) -> None:
        """Marks where the bases are; where they have stopped, over a few cells."""
        here, rows = _cells(level, self.pose[:, :2]), np.arange(len(grid))
        marked = grid[..., 1]
        marks = np.where(self._stopped, STOPPED, VISITED).astype(np.uint8)
        for x, y in STOP_CELLS[: None if level.cell_m < STOP_MARK_M else 1]:
            rows_here = rows if (x, y) == (0, 0) else rows[self._stopped]
            cells = rows_here, here[rows_here, 0] + x, here[rows_here, 1] + y
            marked[cells] = np.maximum(marked[cells], marks[rows_here])

    def _surfaces(self, depth: NDArray[Any]) -> tuple[NDArray[np.intp], Array]:
        """Returns the surfaces in the images: the row and the point (3,) of each."""
        stride = depth.shape[1] // RAYS_PX
        first = stride // 2
        distances_m = CAMERA_DEPTH_MAX_M * depth[:, first::stride, first::stride, 0]
        in_base_m = distances_m[..., None] * _DIRECTIONS + _CAMERA_M
        # 0 where nothing is seen within the range.
        kept = (distances_m > 0.0) & (distances_m < 0.99 * CAMERA_DEPTH_MAX_M)
        kept &= in_base_m[..., 2] < HIGHEST_M
        arm = kept.copy()
        for axis, (low_m, high_m) in enumerate(ARM_M):
            arm &= (in_base_m[..., axis] > low_m) & (in_base_m[..., axis] < high_m)
        kept &= ~arm
        rows = np.nonzero(kept)[0]
        points_m = in_base_m[kept].astype(np.float32)
        turned = _turned(points_m[:, :2], self.pose[rows, 2])
        points_m[:, :2] = turned + self.pose[rows, :2]
        return rows, points_m

    def _images(self, point_in_base_m: Array) -> NDArray[np.uint8]:
        """Returns the maps as seen from the bases, (N, H, W, C)."""
        rows, channels = len(self.pose), []
        for level, grid in zip(LEVELS, self._grids, strict=True):
            around_m = level.cell_m * _OFFSETS_PX
            where_m = _turned(around_m[None], self.pose[:, None, 2]) + self.pose[:, None, :2]
            cells = _cells(level, where_m)
            shown = grid[np.arange(rows)[:, None], cells[..., 0], cells[..., 1]]
            gaps_m = [np.subtract.outer(-point_in_base_m[:, k], -around_m[:, k]) for k in (0, 1)]
            squared_m2 = np.square(gaps_m[0]) + np.square(gaps_m[1])
            mark = np.exp(squared_m2 * np.float32(-0.5 / (MARK_M + level.cell_m) ** 2))
            channels += [shown[..., 0], shown[..., 1], np.uint8(255.0 * mark)]
        return np.stack(channels, axis=-1).reshape(rows, SIDE_PX, SIDE_PX, CHANNELS)


def _turned(points_m: Array, yaw_rad: Array) -> Array:
    """Returns points (..., 2) turned by angles (...)."""
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    x, y = points_m[..., 0], points_m[..., 1]
    return np.stack((cosine * x - sine * y, sine * x + cosine * y), axis=-1)


def _cells(level: Level, points_m: Array) -> NDArray[np.intp]:
    """Returns the cells (..., 2) of points (..., 2); beyond the map, those at its edge."""
    cells = np.floor(points_m / level.cell_m).astype(np.intp) + level.cells // 2
    return np.clip(cells, 0, level.cells - 1)


def _draw(level: Level, grid: NDArray[np.uint8], rows: NDArray[np.intp], points_m: Array) -> None:
    """Draws points (P, 3) of rows (P,) into the maps (N, C, C, 2)."""
    cells = _cells(level, points_m[:, :2])
    heights = np.where(points_m[:, 2] < FLOOR_M, 0.0, points_m[:, 2] / HIGHEST_M)
    flat = (rows * level.cells + cells[:, 0]) * level.cells + cells[:, 1]
    tops, seen = grid.reshape(-1, 2)[:, 0], grid.reshape(-1, 2)[:, 1]
    np.maximum.at(tops, flat, np.uint8(255.0 * heights))
    seen[flat] = np.maximum(seen[flat], SEEN)


def _rays() -> Array:
    """Returns the rays through the pixels (P, P, 3) in the base frame; x forward, y left."""
    slopes = np.tan(CAMERA_HFOV_RAD / 2) * (2 * (np.arange(RAYS_PX) + 0.5) / RAYS_PX - 1)
    right, down = np.meshgrid(slopes, slopes)
    in_camera = np.stack((np.ones_like(right), -right, -down), axis=-1)  # SAPIEN's axes
    rotation = PLACES["head"].pose().to_transformation_matrix()[:3, :3]
    return (in_camera @ rotation.T).astype(np.float32)


def _offsets() -> Array:
    """Returns the pixels (H W, 2) of a map in the base frame, in pixels: x up, y to the left."""
    centred = (SIDE_PX - 1) / 2 - np.arange(SIDE_PX, dtype=np.float32)
    return np.stack(np.meshgrid(centred, centred, indexing="ij"), axis=-1).reshape(-1, 2)


_DIRECTIONS = _rays()
_OFFSETS_PX = _offsets()
_CAMERA_M = np.array(PLACES["head"].position_m, dtype=np.float32)
