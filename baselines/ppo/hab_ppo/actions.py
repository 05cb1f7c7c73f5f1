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

    def from_env(self, actions: NDArray[Any]) -> Tensor:
        """Returns actions (M, *stored) as the environment takes them in the head's units."""
        ...

    def misfit(self, outputs: Tensor, actions: Tensor) -> Tensor:
        """Returns how far the outputs are from actions (M, *stored) to be cloned, (M,)."""
        ...

    def kl(self, outputs: Tensor, reference: ActionHead, reference_outputs: Tensor) -> Tensor:
        """Returns KL(reference || this) of the distributions, (M,)."""
        ...

    def explore(self, log_std: float) -> None:
        """Sets the spread of the actions, where it does not depend on the state."""
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

    def from_env(self, actions: NDArray[Any]) -> Tensor:
        """See `ActionHead`."""
        share = (np.asarray(actions, np.float32) - self._low) / (self._high - self._low)
        return torch.from_numpy((2 * share - 1).astype(np.float32))

    def misfit(self, outputs: Tensor, actions: Tensor) -> Tensor:
        """Squared error of the means, the mean over the entries of the action."""
        return (outputs - actions).square().mean(dim=-1)

    def kl(self, outputs: Tensor, reference: ActionHead, reference_outputs: Tensor) -> Tensor:
        """See `ActionHead`.

        Per entry: ln(s / s') + (s'^2 + (m' - m)^2) / (2 s^2) - 1/2, with m', s' of the reference.
        """
        assert isinstance(reference, Gaussian)
        spread = self.log_std - reference.log_std
        squares = (2 * reference.log_std).exp() + (reference_outputs - outputs).square()
        return (spread + 0.5 * squares * (-2 * self.log_std).exp() - 0.5).sum(dim=-1)

    def explore(self, log_std: float) -> None:
        """See `ActionHead`."""
        with torch.no_grad():
            self.log_std.fill_(log_std)


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

    def from_env(self, actions: NDArray[Any]) -> Tensor:
        """See `ActionHead`."""
        return torch.from_numpy(np.asarray(actions, np.int64).reshape(len(actions)))

    def misfit(self, outputs: Tensor, actions: Tensor) -> Tensor:
        """Cross-entropy."""
        return -self.log_prob(outputs, actions)

    def kl(self, outputs: Tensor, reference: ActionHead, reference_outputs: Tensor) -> Tensor:
        """See `ActionHead`."""
        logs = reference_outputs.log_softmax(dim=-1)
        return (logs.exp() * (logs - outputs.log_softmax(dim=-1))).sum(dim=-1)

    def explore(self, log_std: float) -> None:
        """A categorical distribution has no spread of its own."""


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
