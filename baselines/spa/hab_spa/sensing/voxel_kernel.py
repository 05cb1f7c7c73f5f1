"""Points in different voxels, compiled by numba."""

from __future__ import annotations

from math import floor

import numpy as np
from numpy.typing import NDArray

from hab_spa.planning.kernel import compiled
from hab_spa.shapes import Array

EMPTY = -1


@compiled
def first_in_voxels(
    points_m: Array, size_m: float, bits: int, table: NDArray[np.int64], first: NDArray[np.int64]
) -> int:
    """Writes the indices of the points (K, 3) that are the first in their voxels.

    Args:
        points_m: The points.
        size_m: Edge of a voxel.
        bits: Bits per index of a voxel's key; see `hab_spa.sensing.voxels`.
        table: (2**n,) hash table of keys, all `EMPTY`, larger than K.
        first: (K,) the indices, in order.

    Returns:
        Their number.
    """
    found, mask, offset = 0, len(table) - 1, 1 << (bits - 1)
    for i in range(len(points_m)):
        x = floor(points_m[i, 0] / size_m) + offset
        y = floor(points_m[i, 1] / size_m) + offset
        z = floor(points_m[i, 2] / size_m) + offset
        key = (x << (2 * bits)) | (y << bits) | z
        at = (x * 73856093 ^ y * 19349663 ^ z * 83492791) & mask  # Teschner et al. 2003
        while table[at] != EMPTY and table[at] != key:
            at = (at + 1) & mask
        if table[at] == EMPTY:
            table[at], first[found] = key, i
            found += 1
    return found
