"""Free floor on the robot's own map, with the shortest ways over it."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import eikonalfm
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hab_navigator.robot_map import CELL_M, CELLS, FLOOR_M, HIGHEST_M, VISITED, RobotMap, cells_of
from hab_tasks.privileged import Array

MARGIN_CELLS = 12
"""Unseen cells kept around what has been seen."""

TIGHT_M, WIDE_M = 0.1, 0.45
"""Clearances at which the base is slowest and fastest: it keeps away from obstacles."""

TIGHT_SHARE = 0.35
"""Speed in the tightest place, as a share."""

UNSEEN_SHARE = 0.7
"""Speed over unseen floor, which may turn out not to be free."""

BLOCKED_SPEED = 1e-6

LEAST_ROOM_CELLS = 40
"""Areas that are smaller are gaps in furniture."""


class SeenFloor:
    """Where the base can go, as far as the map tells; what has not been seen is free.

    Has what `ShortestPathFollower` needs of a `NavigationMap`. Points are in the map's frame.

    Attributes:
        room: (X, Y) cells that the base can reach.
        blocked: (X, Y) cells with obstacles.
    """

    def __init__(self, map_: RobotMap, radius_m: float) -> None:
        """Finds the floor around everything seen, the base and the point.

        Args:
            map_: The map.
            radius_m: Radius of the base.
        """
        here, point = cells_of(map_.pose[:2]), cells_of(map_.point_m)
        found = np.vstack((np.argwhere(map_.seen), here, point))
        self._first = np.maximum(found.min(axis=0) - MARGIN_CELLS, 0)
        last = np.minimum(found.max(axis=0) + MARGIN_CELLS, CELLS - 1)
        part = tuple(slice(a, b + 1) for a, b in zip(self._first, last, strict=True))
        seen = map_.seen[part]
        self.blocked = (map_.tops[part] > 255 * FLOOR_M / HIGHEST_M) & (seen < VISITED)
        self._seen = seen > 0
        gaps: Any = ndimage.distance_transform_edt(~self.blocked)
        self._clearance_m: Array = CELL_M * gaps
        free = self._clearance_m >= radius_m - CELL_M / 4
        self.room = _room(free, here - self._first)

    def cells_of(self, points_m: Array) -> NDArray[np.intp]:
        """Returns the cells (..., 2) of points (..., 2)."""
        last = np.array(self.room.shape) - 1
        return np.clip(cells_of(points_m) - self._first, 0, last)

    def positions(self, cells: NDArray[np.intp]) -> Array:
        """Returns the middles (..., 2) of cells (..., 2)."""
        return CELL_M * (np.asarray(cells) + self._first - CELLS // 2 + 0.5)

    def is_free(self, points_m: Array) -> NDArray[np.bool_]:
        """Whether the base can be at points (..., 2)."""
        x, y = np.moveaxis(self.cells_of(np.asarray(points_m)), -1, 0)
        return self.room[x, y]

    def nearest_free(self, points_m: Array) -> Array:
        """Returns the free position (2,) nearest to a point (2,); a free point unchanged."""
        if self.is_free(points_m):
            return np.asarray(points_m, dtype=float)
        x, y = self.cells_of(points_m)
        return self.positions(self._nearest[:, x, y])

    def clear(self, start_m: Array, end_m: Array) -> bool:
        """Whether the straight line between two points (2,) is free."""
        count = 1 + int(np.ceil(3 * np.linalg.norm(end_m - start_m) / CELL_M))
        share = np.linspace(0.0, 1.0, 1 + count)[:, None]
        return bool(self.is_free(start_m + share * (end_m - start_m)).all())

    def geodesic_field(self, goals_m: Array) -> Array:
        """Returns the way [m] from every cell to a free position (2,), (X, Y).

        Tight and unseen places count as longer; inf where the base cannot be.
        """
        x, y = self.cells_of(goals_m)
        field = eikonalfm.fast_marching(self._speed, (int(x), int(y)), (CELL_M, CELL_M), 1)
        return np.where(self.room, field, np.inf)

    @cached_property
    def _speed(self) -> Array:
        share = np.clip((self._clearance_m - TIGHT_M) / (WIDE_M - TIGHT_M), TIGHT_SHARE, 1.0)
        share = np.where(self._seen, share, UNSEEN_SHARE * share)
        return np.where(self.room, share, BLOCKED_SPEED)

    @cached_property
    def _nearest(self) -> NDArray[np.intp]:
        """Nearest free cell of every cell, (2, X, Y)."""
        return _nearest(self.room)


def _room(free: NDArray[np.bool_], here: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Returns the free area (X, Y) in which a cell (2,) is, or the one next to it.

    A base that touches something is not in a free cell.
    """
    found: Any = ndimage.label(free)
    areas = found[0]
    sizes = np.bincount(areas.ravel())
    sizes[0] = 0
    large = sizes[areas] >= min(LEAST_ROOM_CELLS, sizes.max())
    x, y = _nearest(large)[:, here[0], here[1]]
    return areas == areas[x, y]


def _nearest(cells: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Returns which of some cells (X, Y) is nearest to every cell, (2, X, Y)."""
    found: Any = ndimage.distance_transform_edt(~cells, return_distances=False, return_indices=True)
    return found
