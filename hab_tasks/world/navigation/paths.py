"""Shortest paths of the base, simplified to few straight segments."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hab_tasks.privileged import Array
from hab_tasks.world.navigation.navigation_map import NavigationMap

_STEPS = np.array([(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)])
_LENGTHS = np.linalg.norm(_STEPS, axis=1)


def path_between(map_: NavigationMap, start_m: Array, goal_m: Array) -> Array:
    """Returns the shortest path from a point (2,) to another.

    It descends the goal's distance field from cell to cell, and then removes waypoints that a
    straight segment can skip.

    Returns:
        Waypoints (W, 2), `start_m` first. If `start_m` is not free, the second is the nearest free
        position; the last is the free position nearest to `goal_m`. All segments between free
        positions are free.
    """
    start, goal = map_.nearest_free(start_m), map_.nearest_free(goal_m)
    cells = descend(map_.geodesic_field(goal), map_.cells_of(start))
    points = np.concatenate((start[None], map_.positions(cells), goal[None]))
    kept = [0]
    for index in range(2, len(points)):
        if not map_.clear(points[kept[-1]], points[index]):
            kept.append(index - 1)
    waypoints = points[[*kept, len(points) - 1]]
    if map_.is_free(start_m):
        return waypoints
    return np.concatenate((np.asarray(start_m, dtype=float)[None, :2], waypoints))


def descend(field: Array, start: NDArray[np.int64], most: int | None = None) -> NDArray[np.int64]:
    """Returns the cells (C, 2) of steepest descent of a distance field, without `start`.

    Args:
        field: (X, Y) distances, inf where the floor is not free.
        start: A free cell (2,).
        most: Maximum number of cells; None to descend to the goal.
    """
    ringed = np.pad(field, 1, constant_values=np.inf)
    cell = start + 1
    passed = []
    while most is None or len(passed) < most:
        around = cell + _STEPS
        values = ringed[around[:, 0], around[:, 1]]
        # A diagonal step must not cut the corner of an obstacle.
        sides = np.isfinite(ringed[cell[0] + _STEPS[:, 0], cell[1]])
        sides &= np.isfinite(ringed[cell[0], cell[1] + _STEPS[:, 1]])
        slope = np.where(sides, (ringed[tuple(cell)] - values) / _LENGTHS, -np.inf)
        if slope.max() <= 0:
            break
        cell = around[int(slope.argmax())]
        passed.append(cell)
    return np.array(passed, dtype=np.int64).reshape(-1, 2) - 1
