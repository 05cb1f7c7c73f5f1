"""Distributions of actions: Gaussian for `Box` spaces, categorical for `Discrete` ones."""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from torch import Tensor, nn

from hab_tasks.errors import OptionError


class ActionHead(Protocol):
    """Turns the actor's outputs (M, size) into actions.

    Attributes:
        size: Width of the actor's output.
        stored: Shape of a stored action.
    """

    size: int
    stored: tuple[int, ...]

    def sample(self, outputs: Tensor, generator: torch.Generator | None) -> Tensor:
        """Returns actions (M, *stored); the most likely ones without a generator."""
        ...

    def log_prob(self, outputs: Tensor, actions: Tensor) -> Tensor:
        """Returns the log-probabilities (M,) of actions (M, *stored)."""
        ...

    def entropy(self, outputs: Tensor) -> Tensor:
        """Returns the entropies (M,)."""
        ...

    def to_env(self, actions: Tensor) -> NDArray[Any]:
        """Returns actions as the environment takes them."""
        ...


class Gaussian(nn.Module):
    """Independent Gaussians whose standard deviations do not depend on the state.

    Means and samples are in units in which the space reaches from -1 to 1; the environment gets
    them clipped.
    """

    def __init__(self, space: spaces.Box, log_std: float) -> None:
        super().__init__()
        low, high = space.low.astype(np.float32), space.high.astype(np.float32)
        if not (np.isfinite(low).all() and np.isfinite(high).all()):
            raise OptionError("A policy needs a bounded action space.")
        self._low, self._high = low, high
        self._dtype: Any = space.dtype
        self.size = int(np.prod(space.shape))
        self.stored = (self.size,)
        self.log_std = nn.Parameter(torch.full((self.size,), log_std))

    def sample(self, outputs: Tensor, generator: torch.Generator | None) -> Tensor:
        """See `ActionHead`."""
        if generator is None:
            return outputs
        noise = torch.randn(outputs.shape, generator=generator, device=outputs.device)
        return outputs + self.log_std.exp() * noise

    def log_prob(self, outputs: Tensor, actions: Tensor) -> Tensor:
        """See `ActionHead`."""
        deviation = (actions - outputs) * (-self.log_std).exp()
        constant = 0.5 * self.size * math.log(2 * math.pi)
        return -0.5 * deviation.square().sum(dim=-1) - self.log_std.sum() - constant

    def entropy(self, outputs: Tensor) -> Tensor:
        """See `ActionHead`."""
        constant = 0.5 * self.size * (1 + math.log(2 * math.pi))
        return (self.log_std.sum() + constant).expand(len(outputs))

    def to_env(self, actions: Tensor) -> NDArray[Any]:
        """See `ActionHead`."""
        share = 0.5 + 0.5 * np.clip(actions.cpu().numpy(), -1, 1)
        return (self._low + share * (self._high - self._low)).astype(self._dtype)


class Categorical(nn.Module):
    """One of a number of cells."""

    def __init__(self, space: spaces.Discrete) -> None:
        super().__init__()
        self.size = int(space.n)
        self.stored = ()

    def sample(self, outputs: Tensor, generator: torch.Generator | None) -> Tensor:
        """See `ActionHead`."""
        if generator is None:
            return outputs.argmax(dim=-1)
        drawn = torch.multinomial(outputs.softmax(dim=-1), 1, generator=generator)
        return drawn[:, 0]

    def log_prob(self, outputs: Tensor, actions: Tensor) -> Tensor:
        """See `ActionHead`."""
        logs = outputs.log_softmax(dim=-1)
        return logs.gather(-1, actions.long()[:, None])[:, 0]

    def entropy(self, outputs: Tensor) -> Tensor:
        """See `ActionHead`."""
        logs = outputs.log_softmax(dim=-1)
        return -(logs.exp() * logs).sum(dim=-1)

    def to_env(self, actions: Tensor) -> NDArray[Any]:
        """See `ActionHead`."""
        return actions.cpu().numpy()


def action_head(space: spaces.Space[Any], log_std: float) -> Gaussian | Categorical:
    """Returns the head for an action space.

    Raises:
        OptionError: Neither a bounded `Box` nor `Discrete`.
    """
    if isinstance(space, spaces.Discrete):
        return Categorical(space)
    if isinstance(space, spaces.Box):
        return Gaussian(space, log_std)
    raise OptionError(f"A policy cannot act in the space {space}.")
