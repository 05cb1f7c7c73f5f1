"""Examples to be cloned: observations with the actions that are right there, in whole episodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from hab_ppo.observation import Observation


@dataclass(frozen=True, kw_only=True)
class Examples:
    """M steps in E episodes, one after another.

    Attributes:
        state: (M, S) float32.
        images: (M, C, H, W) uint8 or float16; None without.
        actions: (M, A) float32 actions as the environment takes them, or (M,) int64 cells.
        lengths: (E,) number of steps of each episode.
    """

    state: Tensor
    images: Tensor | None
    actions: Tensor
    lengths: Tensor

    @classmethod
    def of(cls, seen: Sequence[Observation], actions: NDArray[Any]) -> Examples:
        """Returns an episode of single observations (1, ...) with their actions (M, ...)."""
        images = None
        if seen[0].images is not None:
            images = compact(torch.cat([obs.images for obs in seen if obs.images is not None]))
        return cls(
            state=torch.cat([obs.state for obs in seen]),
            images=images,
            actions=torch.from_numpy(np.ascontiguousarray(actions)),
            lengths=torch.tensor([len(seen)]),
        )

    @classmethod
    def joined(cls, parts: Sequence[Examples]) -> Examples:
        """Returns the episodes of several in one."""
        images = [part.images for part in parts if part.images is not None]
        return cls(
            state=torch.cat([part.state for part in parts]),
            images=torch.cat(images) if images else None,
            actions=torch.cat([part.actions for part in parts]),
            lengths=torch.cat([part.lengths for part in parts]),
        )

    @classmethod
    def of_tensors(cls, tensors: Mapping[str, Tensor]) -> Examples:
        """Returns the examples in what `tensors` returned, which may hold more."""
        return cls(
            state=tensors["state"],
            images=tensors.get("images"),
            actions=tensors["actions"],
            lengths=tensors["lengths"],
        )

    def tensors(self) -> dict[str, Tensor]:
        """Returns the attributes by name, without images if there are none."""
        found = {"state": self.state, "actions": self.actions, "lengths": self.lengths}
        return found if self.images is None else {**found, "images": self.images}

    def split(self) -> list[Examples]:
        """Returns each episode on its own."""
        lengths = self.lengths.tolist()
        states, actions = self.state.split(lengths), self.actions.split(lengths)
        none = [None] * len(lengths)
        images = none if self.images is None else self.images.split(lengths)
        return [
            Examples(state=state, images=image, actions=action, lengths=torch.tensor([length]))
            for state, image, action, length in zip(states, images, actions, lengths, strict=True)
        ]

    def episodes(self, numbers: Tensor) -> Examples:
        """Returns some of the episodes, by their numbers (K,), in this order."""
        ends = self.lengths.cumsum(0)
        steps = [torch.arange(int(ends[n] - self.lengths[n]), int(ends[n])) for n in numbers]
        chosen = torch.cat(steps) if steps else torch.zeros(0, dtype=torch.long)
        return self.steps(chosen, self.lengths[numbers])

    def steps(self, chosen: Tensor, lengths: Tensor) -> Examples:
        """Returns some of the steps, by their numbers (K,), as episodes of these lengths."""
        return Examples(
            state=self.state[chosen],
            images=None if self.images is None else self.images[chosen],
            actions=self.actions[chosen],
            lengths=lengths,
        )

    def observations(self) -> Observation:
        """Returns the observations of all steps."""
        return Observation(self.state, self.images)

    def starts(self) -> Tensor:
        """Returns whether an episode starts in each step, (M,) bool."""
        starts = torch.zeros(len(self.state), dtype=torch.bool)
        starts[self.lengths.cumsum(0) - self.lengths] = True
        return starts

    @property
    def megabytes(self) -> float:
        """Memory of the data [MB]."""
        tensors = [self.state, self.actions, *([] if self.images is None else [self.images])]
        return sum(tensor.nbytes for tensor in tensors) / 1e6


def compact(images: Tensor) -> Tensor:
    """Returns images as they are kept: uint8 as they are, else float16."""
    return images if images.dtype == torch.uint8 else images.half()
