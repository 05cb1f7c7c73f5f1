"""What the episodes of a batch ask for, in the order in which a task names its objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import torch
from torch import Tensor

from hab_tasks.arrays import Rows, put_rows, to_tensor


@dataclass(frozen=True, kw_only=True)
class Goals:
    """Fixed for an episode; N rows, K objects to rearrange, J doors and drawers.

    Attributes:
        starts_m: (N, K, 3) where the objects' centres of mass were when the episode began.
        goals_m: (N, K, 3) where they are to be; where nothing is to be placed, the start.
        joint_lower: (N, J) lower limit of the doors' and drawers' joints [m or rad].
        joint_upper: (N, J) upper limit.
        front: (N, J, 3) x [m], y [m], yaw [rad] of the frame that looks out of the furniture.
        base: (N, 3) x [m], y [m], yaw [rad] where Navigate has to end.
    """

    starts_m: Rows
    goals_m: Rows
    joint_lower: Rows
    joint_upper: Rows
    front: Rows
    base: Rows

    @staticmethod
    def empty(
        count: int, objects: int, fronts: int, device: torch.device | str | None = None
    ) -> Goals:
        """Returns goals that are all zero, joint travels one.

        Args:
            count: Number of rows.
            objects: Number of objects.
            fronts: Number of doors and drawers.
            device: Where the tensors are; None for numpy arrays.
        """

        def zeros(*shape: int) -> Rows:
            if device is None:
                return np.zeros((count, *shape), dtype=np.float32)
            return torch.zeros(count, *shape, device=device)

        return Goals(
            starts_m=zeros(objects, 3),
            goals_m=zeros(objects, 3),
            joint_lower=zeros(fronts),
            joint_upper=zeros(fronts) + 1.0,
            front=zeros(fronts, 3),
            base=zeros(3),
        )

    def state(self) -> dict[str, Tensor]:
        """Returns copies of all entries by name."""
        return {f.name: to_tensor(getattr(self, f.name)) for f in fields(self)}

    def changed(self, rows: Sequence[int] | Tensor, values: dict[str, Rows]) -> Goals:
        """Returns goals with `values` (R, ...) in `rows` (R,)."""
        old = {f.name: getattr(self, f.name) for f in fields(self)}
        new = {name: put_rows(old[name], rows, value) for name, value in values.items()}
        return Goals(**old | new)
