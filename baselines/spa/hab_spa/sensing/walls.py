"""Walls beside furniture are supposed to go on where nothing has been seen yet."""

from __future__ import annotations

import numpy as np

from hab_spa.shapes import Array

BESIDE_M, NEAR_M = (0.4, 1.3), 0.02
"""Lateral distances of a wall from the furniture's middle, and half of its thickness."""

SHORTEST_M, LEAST_HIGH_M = 0.3, 0.6
"""Smallest seen part of a wall."""

HEIGHTS_M, ON_M = (0.2, 1.5), 1.2
"""A wall is supposed at these heights, so far beyond what is seen of it."""


def supposed_walls(points_m: Array, pose: Array, spacing_m: float) -> Array:
    """Returns points (K, 3) where walls at right angles to a front go on, away from it.

    Args:
        points_m: (P, 3) seen surfaces other than the furniture's.
        pose: Position (2,) of the middle of the front and yaw of its normal.
        spacing_m: Spacing of the points.
    """
    x, y, yaw = pose[:3]
    gaps_m = points_m - (x, y, 0.0)
    out_m = np.cos(yaw) * gaps_m[:, 0] + np.sin(yaw) * gaps_m[:, 1]
    along_m = np.cos(yaw) * gaps_m[:, 1] - np.sin(yaw) * gaps_m[:, 0]
    found = [np.zeros((0, 3))]
    for side in (1, -1):
        end_m, aside_m = _nearest(out_m, side * along_m, points_m[:, 2])
        if np.isnan(end_m):
            continue
        on_m = np.arange(end_m, end_m + ON_M, spacing_m)
        out, high = (one.ravel() for one in np.meshgrid(on_m, np.arange(*HEIGHTS_M, spacing_m)))
        world_x = x + out * np.cos(yaw) - side * aside_m * np.sin(yaw)
        world_y = y + out * np.sin(yaw) + side * aside_m * np.cos(yaw)
        found.append(np.column_stack((world_x, world_y, high)))
    return np.concatenate(found)


def _nearest(out_m: Array, beside_m: Array, heights_m: Array) -> tuple[float, float]:
    """Returns how far the nearest wall was seen, and its lateral distance; NaN if there is none."""
    for middle_m in np.arange(*BESIDE_M, NEAR_M):
        wall = np.abs(beside_m - middle_m) < NEAR_M
        wall &= (out_m > 0.0) & (heights_m > HEIGHTS_M[0])
        if wall.sum() < 2:
            continue
        near_m, end_m = np.percentile(out_m[wall], (5, 95))
        high_m = np.ptp(np.percentile(heights_m[wall], (5, 95)))
        if end_m - near_m >= SHORTEST_M and high_m >= LEAST_HIGH_M:
            return float(end_m), float(np.median(beside_m[wall]))
    return np.nan, np.nan
