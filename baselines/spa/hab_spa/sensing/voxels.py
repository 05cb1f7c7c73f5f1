"""Occupied voxels of the world, over several views, and as obstacles of the arm (S App. D, SPA)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter

from hab_spa.planning.items import Obstacle
from hab_spa.sensing.cloud import DepthView
from hab_spa.shapes import Array
from hab_tasks.world.raycast.compiled import load

_BITS = 20
"""Bits per index of a key; 10 km for voxels of 1 cm."""
_OFFSET = 1 << (_BITS - 1)


@dataclass(frozen=True, kw_only=True)
class VoxelConfig:
    """Parameters of the voxels.

    Attributes:
        size_m: Edge of a voxel.
        through_m: A voxel is free if a camera sees at least this far behind it.
    """

    size_m: float = 0.012
    through_m: float = 0.05


@lru_cache(maxsize=1)
def _kernel() -> Any:
    """Returns the module `hab_spa.sensing.voxel_kernel`, compiled."""
    return load("hab_spa.sensing.voxel_kernel", _compile)


def _compile(module: Any) -> None:
    """Looks at no points."""
    none = np.zeros(0, dtype=np.int64)
    module.first_in_voxels(np.zeros((0, 3)), 1.0, _BITS, none, none)


def first_in_voxels(points_m: Array, size_m: float) -> NDArray[np.int64]:
    """Returns the indices of the points (K, 3) that are the first in their voxels, in order."""
    table = np.full(1 << (2 * len(points_m)).bit_length(), -1, dtype=np.int64)
    first = np.empty(len(points_m), dtype=np.int64)
    points_m = np.ascontiguousarray(points_m)
    return first[: _kernel().first_in_voxels(points_m, size_m, _BITS, table, first)]


def voxel_keys(points_m: Array, size_m: float) -> NDArray[np.int64]:
    """Returns the voxel keys (K,) of points (K, 3)."""
    indices = np.floor(points_m / size_m).astype(np.int64) + _OFFSET
    return (indices[:, 0] << (2 * _BITS)) | (indices[:, 1] << _BITS) | indices[:, 2]


class VoxelMap:
    """Set of occupied voxels; voxels that a camera sees through are removed."""

    def __init__(self, config: VoxelConfig | None = None) -> None:
        """Creates an empty set."""
        self.config = config or VoxelConfig()
        self._keys = self._marked = np.zeros(0, dtype=np.int64)

    def __len__(self) -> int:
        """Returns the number of occupied voxels."""
        return len(self._keys)

    def centres_m(self) -> Array:
        """Returns the centres (V, 3) of the occupied voxels."""
        return self._centres_m(self._keys)

    def mark(self) -> None:
        """Marks the current voxels as known, for `new_m`."""
        self._marked = self._keys

    def new_m(self) -> Array:
        """Returns the centres (V, 3) of the voxels added since `mark`."""
        if not len(self._marked):
            return self.centres_m()
        places = np.searchsorted(self._marked, self._keys).clip(max=len(self._marked) - 1)
        return self._centres_m(self._keys[self._marked[places] != self._keys])

    def add(self, points_m: Array) -> None:
        """Adds the voxels of points (K, 3)."""
        # A view has ten points a voxel, and sorting them would take most of a look.
        size_m = self.config.size_m
        new = np.sort(voxel_keys(points_m[first_in_voxels(points_m, size_m)], size_m))
        # Stable, which is a merge of two sorted runs.
        keys = np.sort(np.concatenate((self._keys, new)), kind="stable")
        self._keys = keys[np.append(True, keys[1:] != keys[:-1])[: len(keys)]]

    def clear(self, emptied: NDArray[np.bool_]) -> None:
        """Removes the masked voxels (V,), in the order of `centres_m`."""
        self._keys = self._keys[~emptied]

    def crop(self, centre_m: Array, reach_m: float) -> None:
        """Removes the voxels farther than `reach_m` from a point (3,)."""
        self.clear(((self.centres_m() - centre_m) ** 2).sum(axis=1) >= reach_m**2)

    def carve(self, view: DepthView) -> None:
        """Removes the voxels that a view sees through."""
        inside, pixels, depth_m = view.project(self.centres_m())
        # Minimum over neighbouring pixels, because a voxel covers more than one.
        behind_m = minimum_filter(view.depth_m, size=3, mode="nearest")
        farther = behind_m[pixels[:, 0], pixels[:, 1]] > depth_m + self.config.through_m
        emptied = np.zeros(len(self), dtype=bool)
        emptied[inside] = farther
        self.clear(emptied)

    def _centres_m(self, keys: NDArray[np.int64]) -> Array:
        shifts = np.array((2 * _BITS, _BITS, 0))
        indices = (keys[:, None] >> shifts) & ((1 << _BITS) - 1)
        return (indices.astype(float) - _OFFSET + 0.5) * self.config.size_m


NEAR = 4
"""Voxels of a cube of so many edges follow each other."""


def voxel_obstacles(centres_m: Array, size_m: float, cell_m: float) -> list[Obstacle]:
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
