"""Octrees of occupied voxels, for Coal's collision checks (S App. D, SPA)."""

from __future__ import annotations

import coal  # pyright: ignore[reportMissingImports]  # compiled, no stubs
import numpy as np

from hab_spa.planning.items import Obstacle
from hab_spa.shapes import Array


def octrees(centres_m: Array, size_m: float, cell_m: float) -> list[Obstacle]:
    """Returns voxels as obstacles, with one octree per grid cell.

    Margins are relaxed per pair of shapes. With a single octree, an arm that starts near one voxel
    could approach all of them.

    Args:
        centres_m: (V, 3) centres of the voxels in the world.
        size_m: Edge of a voxel.
        cell_m: Edge of a grid cell.
    """
    if not len(centres_m):
        return []
    cells = np.floor(centres_m / cell_m).astype(np.int64)
    order = np.lexsort(cells.T)
    cells, centres_m = cells[order], centres_m[order]
    borders = np.flatnonzero((cells[1:] != cells[:-1]).any(axis=1)) + 1
    found = []
    for own_m, cell in zip(np.split(centres_m, borders), cells[np.append(0, borders)], strict=True):
        found.append(
            Obstacle(
                name="seen_" + "_".join(str(index) for index in cell),
                geometry=coal.makeOctree(own_m, size_m),
                lower_m=own_m.min(axis=0) - size_m / 2,
                upper_m=own_m.max(axis=0) + size_m / 2,
            )
        )
    return found
