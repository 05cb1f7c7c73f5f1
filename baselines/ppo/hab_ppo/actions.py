"""Distributions of actions: Gaussian for `Box` spaces, with a binary gripper; or categorical.

The random numbers of drawn actions may be correlated over steps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from hab_tasks.errors import OptionError


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


class ActionHead(Protocol):
    """Turns the actor's outputs (M, size) into actions.

    Attributes:
        size: Width of the actor's output.
        stored: Shape of a stored action.
    """

    size: int
    stored: tuple[int, ...]

    def sample(self, outputs: Tensor, noise: Noise | None) -> Tensor:
        """Returns actions (M, *stored); the most likely ones without noise."""
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

    def fix_spread(self) -> None:
        """Excludes the spread from learning; only `explore` changes it."""
        ...


class Gaussian(nn.Module):
    """Independent Gaussians whose standard deviations do not depend on the state.

    Means and samples are in units in which the space reaches from -1 to 1; the environment gets
    them clipped. Binary entries, such as the gripper, are -1 or 1 instead: their output is the
    logit of 1. (The mean of a Gaussian gripper tells nothing of when it closes under noise.)
    """

    _binary: Tensor

    def __init__(self, space: spaces.Box, log_std: float, binary: Sequence[int] = ()) -> None:
        """Creates a head; `binary` are the indices of the binary entries."""
        super().__init__()
        low, high = space.low.astype(np.float32), space.high.astype(np.float32)
        if not (np.isfinite(low).all() and np.isfinite(high).all()):
            raise OptionError("A policy needs a bounded action space.")
        self._low, self._high = low, high
        self._dtype: Any = space.dtype
        self.size = int(np.prod(space.shape))
        self.stored = (self.size,)
        self.log_std = nn.Parameter(torch.full((self.size,), log_std))
        chosen = torch.zeros(self.size, dtype=torch.bool)
        chosen[list(binary)] = True
        self.register_buffer("_binary", chosen, persistent=False)

    def sample(self, outputs: Tensor, noise: Noise | None) -> Tensor:
        """See `ActionHead`."""
        if noise is None:
            return torch.where(self._binary, torch.where(outputs >= 0, 1.0, -1.0), outputs)
        drawn = noise.normal(outputs)
        shares = torch.special.ndtr(drawn)  # uniform, and correlated as the noise is
        switched = torch.where(shares < outputs.sigmoid(), 1.0, -1.0)
        return torch.where(self._binary, switched, outputs + self.log_std.exp() * drawn)

    def log_prob(self, outputs: Tensor, actions: Tensor) -> Tensor:
        """See `ActionHead`."""
        deviation = (actions - outputs) * (-self.log_std).exp()
        density = -0.5 * deviation.square() - self.log_std - 0.5 * math.log(2 * math.pi)
        switched = functional.logsigmoid(outputs * actions)
        return torch.where(self._binary, switched, density).sum(dim=-1)

    def entropy(self, outputs: Tensor) -> Tensor:
        """See `ActionHead`."""
        spread = self.log_std + 0.5 * (1 + math.log(2 * math.pi))
        # H = -p ln p - (1 - p) ln(1 - p), and 1 - p = sigmoid(-x).
        share = outputs.sigmoid()
        switched = -share * functional.logsigmoid(outputs)
        switched = switched - (1 - share) * functional.logsigmoid(-outputs)
        return torch.where(self._binary, switched, spread.expand_as(outputs)).sum(dim=-1)

    def to_env(self, actions: Tensor) -> NDArray[Any]:
        """See `ActionHead`."""
        share = 0.5 + 0.5 * np.clip(actions.cpu().numpy(), -1, 1)
        return (self._low + share * (self._high - self._low)).astype(self._dtype)

    def from_env(self, actions: NDArray[Any]) -> Tensor:
        """See `ActionHead`."""
        share = (np.asarray(actions, np.float32) - self._low) / (self._high - self._low)
        return torch.from_numpy((2 * share - 1).astype(np.float32))

    def misfit(self, outputs: Tensor, actions: Tensor) -> Tensor:
        """Mean over the entries of squared errors, or cross-entropies of binary entries."""
        switched = -functional.logsigmoid(outputs * torch.where(actions >= 0, 1.0, -1.0))
        squares = (outputs - actions).square()
        return torch.where(self._binary, switched, squares).mean(dim=-1)

    def kl(self, outputs: Tensor, reference: ActionHead, reference_outputs: Tensor) -> Tensor:
        """See `ActionHead`.

        Per entry: ln(s / s') + (s'^2 + (m' - m)^2) / (2 s^2) - 1/2, with m', s' of the reference;
        of a binary one, p' ln(p' / p) + (1 - p') ln((1 - p') / (1 - p)).
        """
        assert isinstance(reference, Gaussian)
        spread = self.log_std - reference.log_std
        squares = (2 * reference.log_std).exp() + (reference_outputs - outputs).square()
        continuous = spread + 0.5 * squares * (-2 * self.log_std).exp() - 0.5
        share, log = reference_outputs.sigmoid(), functional.logsigmoid
        switched = share * (log(reference_outputs) - log(outputs))
        switched = switched + (1 - share) * (log(-reference_outputs) - log(-outputs))
        return torch.where(self._binary, switched, continuous).sum(dim=-1)

    def explore(self, log_std: float) -> None:
        """See `ActionHead`."""
        with torch.no_grad():
            self.log_std.fill_(log_std)

    def fix_spread(self) -> None:
        """See `ActionHead`."""
        self.log_std.requires_grad_(False)


class Categorical(nn.Module):
    """One of a number of cells."""

    def __init__(self, space: spaces.Discrete) -> None:
        super().__init__()
        self.size = int(space.n)
        self.stored = ()

    def sample(self, outputs: Tensor, noise: Noise | None) -> Tensor:
        """See `ActionHead`."""
        if noise is None:
            return outputs.argmax(dim=-1)
        return noise.pick(outputs.softmax(dim=-1))

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

    def fix_spread(self) -> None:
        """Likewise."""


def action_head(
    space: spaces.Space[Any], log_std: float, binary: Sequence[int] = ()
) -> Gaussian | Categorical:
    """Returns the head for an action space.

    Args:
        space: The space.
        log_std: Initial logarithm of the standard deviation of continuous actions.
        binary: Indices of the entries of a `Box` that are only ever -1 or 1.

    Raises:
        OptionError: Neither a bounded `Box` nor `Discrete`.
    """
    if isinstance(space, spaces.Discrete):
        return Categorical(space)
    if isinstance(space, spaces.Box):
        return Gaussian(space, log_std, binary)
    raise OptionError(f"A policy cannot act in the space {space}.")
