"""Goals of the episodes of a batch, in the task's object order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import torch
from torch import Tensor

from hab_tasks.arrays import BatchArray, put_rows, to_tensor


@dataclass(frozen=True, kw_only=True)
class Goals:
    """Goals; constant during an episode. N rows, K objects to rearrange, J doors and drawers.

    Attributes:
        starts_m: (N, K, 3) start positions of the objects' centres of mass.
        goals_m: (N, K, 3) their goal positions; the start where nothing is to be placed.
        joint_lower: (N, J) lower limit of the doors' and drawers' joints [m or rad].
        joint_upper: (N, J) upper limit.
        articulation_frame: (N, J, 3) x [m], y [m], yaw [rad] of the frame facing out of the
            furniture.
        base: (N, 3) x [m], y [m], yaw [rad] of the navigation goal.
    """

    starts_m: BatchArray
    goals_m: BatchArray
    joint_lower: BatchArray
    joint_upper: BatchArray
    articulation_frame: BatchArray
    base: BatchArray

    @staticmethod
    def empty(
        count: int, objects: int, articulations: int, device: torch.device | str | None = None
    ) -> Goals:
        """Returns goals of zeros, with joint travels of one.

        Args:
            count: Number of rows.
            objects: Number of objects.
            articulations: Number of doors and drawers.
            device: Device of the tensors; None for numpy arrays.
        """

        def zeros(*shape: int) -> BatchArray:
            if device is None:
                return np.zeros((count, *shape), dtype=np.float32)
            return torch.zeros(count, *shape, device=device)

        return Goals(
            starts_m=zeros(objects, 3),
            goals_m=zeros(objects, 3),
            joint_lower=zeros(articulations),
            joint_upper=zeros(articulations) + 1.0,
            articulation_frame=zeros(articulations, 3),
            base=zeros(3),
        )

    def state(self) -> dict[str, Tensor]:
        """Returns copies of all entries by name."""
        return {f.name: to_tensor(getattr(self, f.name)) for f in fields(self)}

    def changed(self, rows: Sequence[int] | Tensor, values: dict[str, BatchArray]) -> Goals:
        """Returns goals with `values` (R, ...) in `rows` (R,)."""
        old = {f.name: getattr(self, f.name) for f in fields(self)}
        new = {name: put_rows(old[name], rows, value) for name, value in values.items()}
        return Goals(**old | new)
