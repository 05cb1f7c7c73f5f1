"""What the episodes of a batch ask for, in the order in which a task names its objects."""

from __future__ import annotations

from dataclasses import dataclass, fields

import torch
from torch import Tensor


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

    starts_m: Tensor
    goals_m: Tensor
    joint_lower: Tensor
    joint_upper: Tensor
    front: Tensor
    base: Tensor

    @staticmethod
    def empty(count: int, objects: int, fronts: int, device: torch.device | str) -> Goals:
        """Returns goals of `count` rows that are all zero, joint travels one."""

        def zeros(*shape: int) -> Tensor:
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
        return {f.name: getattr(self, f.name).clone() for f in fields(self)}

    def changed(self, rows: Tensor, values: dict[str, Tensor]) -> Goals:
        """Returns goals with `values` (R, ...) in `rows` (R,)."""
        merged = self.state()
        for name, value in values.items():
            merged[name][rows] = value.to(merged[name].dtype)
        return Goals(**merged)
