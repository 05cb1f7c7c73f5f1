"""Random numbers of sampled actions, which may be correlated over steps."""

from __future__ import annotations

import math

import torch
from torch import Tensor


class ActionNoise:
    """Draws the noise of one step after another.

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
