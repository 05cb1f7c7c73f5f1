"""Goals of the episodes of a batch, in the task's object order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from torch import Tensor

from hab_tasks.arrays import Floats, put_rows, to_tensor


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
        rest_m: (N, 3) resting position of the end-effector, base frame.
    """

    starts_m: Floats
    goals_m: Floats
    joint_lower: Floats
    joint_upper: Floats
    articulation_frame: Floats
    base: Floats
    rest_m: Floats

    @staticmethod
    def empty(count: int, objects: int, articulations: int) -> Goals:
        """Returns goals of zeros, with joint travels of one, for a number of rows."""

        def zeros(*shape: int) -> Floats:
            return np.zeros((count, *shape), dtype=np.float32)

        return Goals(
            starts_m=zeros(objects, 3),
            goals_m=zeros(objects, 3),
            joint_lower=zeros(articulations),
            joint_upper=zeros(articulations) + 1.0,
            articulation_frame=zeros(articulations, 3),
            base=zeros(3),
            rest_m=zeros(3),
        )

    def state(self) -> dict[str, Tensor]:
        """Returns copies of all entries by name."""
        return {f.name: to_tensor(getattr(self, f.name)) for f in fields(self)}

    def changed(self, rows: Sequence[int], values: Mapping[str, Any]) -> Goals:
        """Returns goals with `values` (R, ...) in `rows` (R,)."""
        old = {f.name: getattr(self, f.name) for f in fields(self)}
        new = {name: put_rows(old[name], rows, value) for name, value in values.items()}
        return Goals(**old | new)
