"""Small random motions, identical for both environments of a benchmark."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from hab_tasks.constants import EE_STEP_M

BASE_SPEEDS = (0.2, 0.6)
"""Maximum base speeds: forward [m/s], turning [rad/s]. The base stays within about 0.1 m."""


@dataclass(frozen=True, kw_only=True)
class Motion:
    """A sequence of small random motions.

    Attributes:
        count: Number of steps.
        seed: Seed of the random numbers.
        arm: Whether the end-effector moves.
        base: Whether the base moves.
    """

    count: int
    seed: int
    arm: bool = True
    base: bool = False

    def arm_steps_m(self) -> Tensor:
        """Returns end-effector displacements (count, 3) [m]."""
        moved = EE_STEP_M * self._random()[:, :3]
        return moved if self.arm else torch.zeros_like(moved)

    def base_speeds(self) -> Tensor:
        """Returns forward and turning velocity of the base (count, 2) [m/s, rad/s]."""
        speeds = torch.tensor(BASE_SPEEDS) * self._random()[:, 3:]
        return speeds if self.base else torch.zeros_like(speeds)

    def _random(self) -> Tensor:
        """Returns uniform random numbers in [-1, 1], shape (count, 5)."""
        generator = torch.Generator().manual_seed(self.seed)
        return 2.0 * torch.rand(self.count, 5, generator=generator) - 1.0
