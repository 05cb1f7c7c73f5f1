"""Occupied voxels as obstacles of the arm (S App. D, SPA)."""

from __future__ import annotations

import numpy as np

from hab_spa.planning.items import Obstacle
from hab_spa.shapes import Array

NEAR = 4
"""Voxels of a cube of so many edges follow each other."""


def octrees(centres_m: Array, size_m: float, cell_m: float) -> list[Obstacle]:
    """Returns voxels as obstacles, one for each grid cell.

    Margins are relaxed per pair of shapes. With a single obstacle, an arm that starts near one
    voxel could approach all of them.

    Args:
        centres_m: (V, 3) centres of the voxels in the world.
        size_m: Edge of a voxel.
        cell_m: Edge of a grid cell.
    """
    if not len(centres_m):
        return []
    cells = np.floor(centres_m / cell_m).astype(np.int64)
    order = np.lexsort((*np.floor(centres_m / (NEAR * size_m)).T, *cells.T))
    cells, centres_m = cells[order], centres_m[order]
    borders = np.flatnonzero((cells[1:] != cells[:-1]).any(axis=1)) + 1
    found = []
    for own_m, cell in zip(np.split(centres_m, borders), cells[np.append(0, borders)], strict=True):
        found.append(
            Obstacle(
                name="seen_" + "_".join(str(index) for index in cell),
                centres_m=own_m,
                size_m=size_m,
            )
        )
    return found
