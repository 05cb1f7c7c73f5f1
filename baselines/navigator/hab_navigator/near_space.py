"""What has been seen in the space around the point to go to, and from where the hand can come."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hab_tasks.privileged import Array

VOXEL_M = 0.04
SIDE_VOXELS, HIGH_VOXELS = 48, 50
"""Horizontal and vertical numbers of voxels: 1.9 m around the point, and 2 m from the floor."""

SIDES = 24
"""Number of level directions from which the hand may come."""

RISE_M = 0.06
"""The hand's way is a level line this far above the point."""

WAY_M = (0.15, 0.65)
"""Part of the way that counts, by distance from the point; nearer is the object itself."""


class NearSpace:
    """Surfaces around a point (3,), in a map's frame."""

    def __init__(self, point_m: Array) -> None:
        """Has seen nothing yet."""
        self._point_m = np.asarray(point_m, dtype=float)
        self._low_m = np.append(self._point_m[:2] - VOXEL_M * SIDE_VOXELS / 2, 0.0)
        self._seen = np.zeros((SIDE_VOXELS, SIDE_VOXELS, HIGH_VOXELS), dtype=bool)

    def add(self, points_m: NDArray[np.floating]) -> None:
        """Adds surface points (P, 3)."""
        cells = np.floor((points_m - self._low_m) / VOXEL_M).astype(np.intp)
        inside = ((cells >= 0) & (cells < self._seen.shape)).all(axis=1)
        self._seen[tuple(cells[inside].T)] = True

    def clearances_m(self) -> Array:
        """Returns how near the hand's way from each side (SIDES,) comes to what has been seen.

        Side k is at the angle ``2 pi k / SIDES`` from the point.
        """
        if not self._seen.any():
            return np.full(SIDES, np.inf)
        gaps_m: Array = VOXEL_M * np.asarray(ndimage.distance_transform_edt(~self._seen))
        cells = np.floor((_WAYS_M + self._point_m - self._low_m) / VOXEL_M).astype(np.intp)
        cells = np.clip(cells, 0, np.array(self._seen.shape) - 1)
        return gaps_m[tuple(np.moveaxis(cells, -1, 0))].min(axis=1)


def _ways() -> Array:
    """Returns points (SIDES, P, 3) on the hand's ways, relative to the point."""
    along_m = np.arange(WAY_M[0], WAY_M[1], VOXEL_M)
    angles_rad = 2 * math.pi * np.arange(SIDES) / SIDES
    x, y = (along_m * turn(angles_rad)[:, None] for turn in (np.cos, np.sin))
    return np.stack((x, y, np.full_like(x, RISE_M)), axis=-1)


_WAYS_M = _ways()
