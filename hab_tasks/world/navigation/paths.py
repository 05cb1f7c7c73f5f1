"""Shortest paths of the base, and base poses from which the arm reaches a target."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hab_tasks.privileged import Array
from hab_tasks.world.navigation.navigation_map import NavigationMap
from hab_tasks.world.scenes.floor import CELL_M

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

    The field (X, Y) is inf where the floor is not free; `start` (2,) is a free cell. Without
    `most` cells, it descends to the goal.
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


NEAREST_M, FARTHEST_M = 0.45, 1.1
"""Range of horizontal distances from the base to points that the arm can reach."""

_AT_TARGET_M = 0.1
"""Walls within this distance of the target do not occlude it, as furniture is wall-mounted."""


def poses_reaching(
    map_: NavigationMap,
    target_m: Array,
    nearest_m: float = NEAREST_M,
    farthest_m: float = FARTHEST_M,
) -> Array:
    """Returns base poses from which a receptacle, an object or a handle can be reached.

    The line from base to target, (2,) or (3,) in the world, crosses free floor and then only the
    furniture that carries the target: no wall, and no gap behind other furniture.

    Returns:
        (K, 3): x, y and the yaw [rad] that faces the target, nearest first.
    """
    target = np.asarray(target_m, dtype=float)[:2]
    bases = map_.positions(np.argwhere(map_.free))
    gap = target - bases
    distance = np.linalg.norm(gap, axis=1)
    near = np.flatnonzero((distance >= nearest_m) & (distance <= farthest_m))
    near = near[np.argsort(distance[near], kind="stable")]
    near = near[_in_sight(map_, bases[near], target, distance[near])]
    yaw = np.arctan2(gap[near, 1], gap[near, 0])
    return np.column_stack((bases[near], yaw))


def _in_sight(
    map_: NavigationMap, bases_m: Array, target_m: Array, distance_m: Array
) -> NDArray[np.bool_]:
    """Whether only the target's furniture is on the line from bases (K, 2)."""
    count = 1 + int(np.ceil(2 * distance_m.max(initial=0.0) / CELL_M))
    share = np.linspace(0.0, 1.0, 1 + count)
    line = bases_m[:, None] + share[:, None] * (target_m - bases_m)[:, None]
    x, y = np.moveaxis(map_.cells_of(line), -1, 0)
    taken = map_.floor.clearance_m[x, y] == 0
    wall = map_.walls[x, y] & ((1 - share) * distance_m[:, None] > _AT_TARGET_M)
    left_again = taken[:, :-1] & ~taken[:, 1:]
    return ~wall.any(axis=1) & ~left_again.any(axis=1)
