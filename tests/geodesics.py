"""Pointwise lookup of distance fields, as a reference for `GeodesicDistances`."""

import numpy as np

from hab_tasks.world.scenes.floor import CELL_M

CORNERS = np.array([(0, 0), (0, 1), (1, 0), (1, 1)])


def geodesic_distance(map_, points_m, field):
    """Distances (...) [m] of points (..., 2) in a field (X, Y) of `map_`.

    From a point that is not free, the way first goes straight to the nearest free position. Between
    the middles of four free cells the distance is bilinear, beside obstacles the shortest way over
    a free cell.
    """
    points = np.asarray(points_m, dtype=float)[..., :2]
    start = map_.nearest_free(points)
    last = np.array(field.shape) - 1
    grid = np.clip((start - map_.floor.origin_m) / CELL_M, 0, last)
    first = np.minimum(np.floor(grid).astype(int), last - 1)
    cells = first[..., None, :] + CORNERS
    values = field[cells[..., 0], cells[..., 1]]
    share = (grid - first)[..., None, :]
    weights = np.abs(1 - CORNERS - share).prod(axis=-1)
    finite = np.isfinite(values)
    smooth = (weights * np.where(finite, values, 0.0)).sum(axis=-1)
    steps = CELL_M * np.linalg.norm(cells - grid[..., None, :], axis=-1)
    found = np.where(finite.all(axis=-1), smooth, (values + steps).min(axis=-1))
    return found + np.linalg.norm(points - start, axis=-1)
