"""Running mean and variance, merged over batches and ranks by Chan's formula (S App. C.1)."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

EPSILON = 1e-8


class Moments(NamedTuple):
    """Moments of a sample, for each of C channels; float64.

    Attributes:
        count: () number of values of each channel.
        mean: (C,).
        squares: (C,) sum of the squared deviations from the mean.
    """

    count: Tensor
    mean: Tensor
    squares: Tensor

    @classmethod
    def of(cls, values: Tensor) -> Moments:
        """Returns the moments of `values` (M, C); M may be 0."""
        if not len(values):
            zeros = torch.zeros(values.shape[1], dtype=torch.float64, device=values.device)
            return cls(torch.zeros((), dtype=torch.float64, device=values.device), zeros, zeros)
        values = values.double()
        mean = values.mean(dim=0)
        count = torch.tensor(float(len(values)), dtype=torch.float64, device=values.device)
        return cls(count, mean, (values - mean).square().sum(dim=0))

    def merged(self, other: Moments) -> Moments:
        """Returns the moments of both samples together."""
        count = self.count + other.count
        share = other.count / count.clamp(min=1)
        step = other.mean - self.mean
        squares = self.squares + other.squares + step.square() * self.count * share
        return Moments(count, self.mean + step * share, squares)

    def packed(self) -> Tensor:
        """Returns all moments as one vector (1 + 2 C,)."""
        return torch.cat((self.count[None], self.mean, self.squares))

    @classmethod
    def unpacked(cls, vector: Tensor) -> Moments:
        """Returns the moments of a `packed` vector (1 + 2 C,)."""
        mean, squares = vector[1:].chunk(2)
        return cls(vector[0], mean, squares)


class RunningNormalizer(nn.Module):
    """Subtracts the running mean and divides by the running standard deviation of each channel.

    It changes only in `learn`, so a policy that acts or is evaluated leaves it alone. Before the
    first `learn` it changes nothing.
    """

    count: Tensor
    mean: Tensor
    squares: Tensor
    _shift: Tensor
    _scale: Tensor

    def __init__(self, channels: int, limit: float = 10.0) -> None:
        """Creates a normaliser whose results are clipped to `limit` standard deviations."""
        super().__init__()
        self._limit = limit
        self.register_buffer("count", torch.zeros((), dtype=torch.float64))
        self.register_buffer("mean", torch.zeros(channels, dtype=torch.float64))
        self.register_buffer("squares", torch.zeros(channels, dtype=torch.float64))
        self.register_buffer("_shift", torch.zeros(channels), persistent=False)
        self.register_buffer("_scale", torch.ones(channels), persistent=False)

    def learn(self, moments: Moments) -> None:
        """Adds a sample, given by its moments."""
        merged = Moments(self.count, self.mean, self.squares).merged(moments)
        self.count.copy_(merged.count)
        self.mean.copy_(merged.mean)
        self.squares.copy_(merged.squares)
        self.refresh()

    def refresh(self) -> None:
        """Computes shift and scale from the moments; to be called after loading them."""
        if self.count > 1:
            self._shift.copy_(self.mean)
            variance = self.squares / self.count
            # A channel that never changed stays as it is, less its mean.
            variance = torch.where(variance > EPSILON, variance, torch.ones_like(variance))
            self._scale.copy_(variance.rsqrt())

    def forward(self, values: Tensor) -> Tensor:
        """Returns normalised values (M, C) or (M, C, H, W), float32."""
        shape = (-1,) + (1,) * (values.dim() - 2)
        shifted = (values - self._shift.view(shape)) * self._scale.view(shape)
        return shifted.clamp(-self._limit, self._limit)
