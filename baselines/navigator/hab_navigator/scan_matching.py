"""Scan matching: where a base that touches something has got to, by what it sees.

Each candidate pose puts the obstacles in the image on the map; they should fall on those that are
there already.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hab_tasks.privileged import Array

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
