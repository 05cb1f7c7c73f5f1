"""How far the bases of a batch still have to go: a distance field for each row."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from hab_tasks.navigation.navigation_map import NavigationMap
from hab_tasks.privileged import Array
from hab_tasks.scenes.floor import CELL_M


class Ways:
    """Geodesic distances to one goal a row; a row without a goal has distance zero."""

    def __init__(self, count: int, device: torch.device | str) -> None:
        self._fields = [torch.zeros(1, 1)] * count
        self._origin_m = torch.zeros(count, 2, device=device)
        self._size = torch.ones(count, 2, device=device)
        self._stack: Tensor | None = None

    def lead(self, row: int, map_: NavigationMap, goal_m: Array) -> None:
        """Makes `goal_m` (2,), or the nearest free position, the goal of a row."""
        field = map_.geodesic_field(np.asarray(goal_m, dtype=float))
        self._fields[row] = torch.from_numpy(map_.everywhere(field).astype(np.float32))
        self._origin_m[row] = torch.as_tensor(map_.floor.origin_m)
        self._stack = None

    def clear(self, row: int) -> None:
        """Leaves a row without a goal."""
        self._fields[row], self._stack = torch.zeros(1, 1), None

    def distance_m(self, base_m: Tensor) -> Tensor:
        """Returns how far bases (N, 2) have to go, (N,) [m], bilinear between cells."""
        if self._stack is None:
            self._stack = self._stacked(base_m.device)
        cells = (base_m - self._origin_m) / CELL_M
        # Grid sampling names places from -1 to 1, the last axis first.
        place = (2.0 * cells / self._size - 1.0).flip(1)[:, None, None]
        found = functional.grid_sample(
            self._stack, place, mode="bilinear", padding_mode="border", align_corners=True
        )
        return found[:, 0, 0, 0]

    def _stacked(self, device: torch.device) -> Tensor:
        """Returns all fields as (N, 1, X, Y); smaller ones go on with their border."""
        x = max(2, *(f.shape[0] for f in self._fields))
        y = max(2, *(f.shape[1] for f in self._fields))
        self._size = torch.tensor([[x - 1.0, y - 1.0]], device=device).expand(len(self._fields), 2)
        padded = [
            functional.pad(f[None, None], (0, y - f.shape[1], 0, x - f.shape[0]), mode="replicate")
            for f in self._fields
        ]
        return torch.cat(padded).to(device)
