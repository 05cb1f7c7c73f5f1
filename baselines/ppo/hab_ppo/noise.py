"""Random numbers of drawn actions, which may be correlated over steps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np
import torch
from torch import Tensor


class Noise(Protocol):
    """Source of random numbers for the actions of N rows."""

    def normal(self, like: Tensor) -> Tensor:
        """Returns standard normal numbers of the shape of a tensor (N, ...)."""
        ...

    def pick(self, shares: Tensor) -> Tensor:
        """Returns a cell for each row (N,), drawn with the probabilities `shares` (N, C)."""
        ...


class ActionNoise:
    """Draws the noise of one step after another, for all rows from one generator.

    At 30 actions a second, independent noise averages out before the hand has moved. Correlated
    noise (arXiv 2312.11091) explores farther: with a correlation c, the number of a step is c times
    that of the step before plus sqrt(1 - c^2) times a new one, so that each has variance 1.
    """

    def __init__(self, generator: torch.Generator, correlation: float = 0.0) -> None:
        """Creates noise without a past; `correlation` is that of successive steps, below 1."""
        self.generator = generator
        self._correlation = correlation
        self._last: Tensor | None = None

    def normal(self, like: Tensor) -> Tensor:
        """Returns standard normal numbers of the shape of a tensor."""
        drawn = torch.randn(like.shape, generator=self.generator, device=like.device)
        if self._last is not None and self._correlation:
            new = math.sqrt(1 - self._correlation**2)
            drawn = self._correlation * self._last + new * drawn
        self._last = drawn
        return drawn

    def pick(self, shares: Tensor) -> Tensor:
        """See `Noise`."""
        return torch.multinomial(shares, 1, generator=self.generator)[:, 0]


class RowNoise:
    """Noise of rows with generators of their own: a row's numbers depend on its own seed alone."""

    def __init__(self, rows: Sequence[np.random.Generator | None]) -> None:
        """Draws from the generators of N rows; a row without one, of unused action, gets 0."""
        self._rows = rows

    def normal(self, like: Tensor) -> Tensor:
        """See `Noise`."""
        shape = like.shape[1:]
        drawn = [np.zeros(shape) if r is None else r.standard_normal(shape) for r in self._rows]
        return torch.from_numpy(np.stack(drawn)).to(like)

    def pick(self, shares: Tensor) -> Tensor:
        """See `Noise`."""
        drawn = torch.tensor([0.0 if row is None else row.random() for row in self._rows])
        passed = shares.double().cumsum(dim=-1) <= drawn.to(shares.device)[:, None]
        return passed.sum(dim=-1).clamp(max=shares.shape[-1] - 1)
