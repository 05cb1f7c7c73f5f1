"""The data of an update: T steps in N rows, and generalised advantage estimation.

The vector environment resets in the step after the last one of an episode (`NEXT_STEP`):

    step       t            t + 1                        t + 2
    sees       a state      the last state               the first state of the next episode
    action     ends it      is ignored, so not valid     counts

The policy looks at the last state in step t + 1 anyway, so its value there is the bootstrap of an
episode that was truncated in step t. A terminated one has none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import torch
from torch import Tensor

from hab_ppo.observation import Observation, ObservationLayout

BY_ROW = ("memory", "last_values")
"""Tensors of a rollout that have no steps."""


@dataclass(kw_only=True)
class Rollout:
    """T steps in N rows; all tensors but the last two are (T, N, ...).

    Attributes:
        state: (T, N, S) float32.
        images: (T, N, C, H, W); None without.
        starts: bool, whether an episode starts in this step.
        valid: bool, whether the action counted.
        actions: (T, N, *stored).
        log_probs: Log-probabilities of the actions when they were chosen.
        values: Values of the states then.
        rewards: Rewards.
        terminated: bool, whether the step ended the episode for good.
        truncated: bool, whether it ended at the time limit.
        memory: (2, N, H) state of the LSTM before the first step.
        last_values: (N,) values of the states after the last step.
    """

    state: Tensor
    images: Tensor | None
    starts: Tensor
    valid: Tensor
    actions: Tensor
    log_probs: Tensor
    values: Tensor
    rewards: Tensor
    terminated: Tensor
    truncated: Tensor
    memory: Tensor
    last_values: Tensor

    @classmethod
    def empty(
        cls, steps: int, rows: int, layout: ObservationLayout, stored: tuple[int, ...], memory: int
    ) -> Rollout:
        """Returns a rollout to be filled in place."""

        def zeros(*shape: int, dtype: torch.dtype = torch.float32) -> Tensor:
            return torch.zeros(steps, rows, *shape, dtype=dtype)

        flags = [zeros(dtype=torch.bool) for _ in range(4)]
        return cls(
            state=zeros(layout.state_size),
            images=None,  # made with the first observation, whose type it has
            starts=flags[0],
            valid=flags[1],
            actions=zeros(*stored),
            log_probs=zeros(),
            values=zeros(),
            rewards=zeros(),
            terminated=flags[2],
            truncated=flags[3],
            memory=torch.zeros(2, rows, memory),
            last_values=torch.zeros(rows),
        )

    def put(self, step: int, obs: Observation) -> None:
        """Stores the observations of a step."""
        self.state[step] = obs.state
        if obs.images is not None:
            if self.images is None:
                self.images = obs.images.new_empty((len(self.state), *obs.images.shape))
            self.images[step] = obs.images

    def first(self, steps: int) -> Rollout:
        """Returns the first steps of a rollout that was cut short."""
        return self._each(lambda value: value[:steps], {})

    def of_rows(self, rows: Tensor) -> Rollout:
        """Returns the rollout of some rows."""
        by_row = {"memory": self.memory[:, rows], "last_values": self.last_values[rows]}
        return self._each(lambda value: value[:, rows], by_row)

    def to(self, device: torch.device | str) -> Rollout:
        """Returns the rollout on a device."""
        by_row = {name: getattr(self, name).to(device) for name in BY_ROW}
        return self._each(lambda value: value.to(device), by_row)

    def observations(self) -> Observation:
        """Returns all observations, flattened to T N rows."""
        images = None if self.images is None else self.images.flatten(0, 1)
        return Observation(self.state.flatten(0, 1), images)

    def _each(self, change: Callable[[Tensor], Tensor], by_row: dict[str, Tensor]) -> Rollout:
        """Returns the rollout with all tensors (T, N, ...) changed, and those `by_row` replaced."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        changed = {
            name: change(value)
            for name, value in values.items()
            if name not in BY_ROW and value is not None
        }
        return Rollout(**{**values, **changed, **by_row})


def gae(rollout: Rollout, discount: float, decay: float) -> Tensor:
    """Returns the generalised advantage estimates (T, N); 0 in steps that are not valid.

    Args:
        rollout: The rollout.
        discount: Gamma.
        decay: Lambda.
    """
    bootstrap = discount * ~rollout.terminated
    carried = discount * decay * ~(rollout.terminated | rollout.truncated)
    following = torch.cat((rollout.values[1:], rollout.last_values[None]))
    errors = rollout.rewards + bootstrap * following - rollout.values
    advantages = torch.zeros_like(errors)
    ahead = torch.zeros_like(rollout.last_values)
    for step in range(len(errors) - 1, -1, -1):
        ahead = errors[step] + carried[step] * ahead
        advantages[step] = ahead
    return advantages * rollout.valid


def discounted_returns(rollout: Rollout, before: Tensor, discount: float) -> Tensor:
    """Returns the discounted sum (T, N) of the rewards of each episode up to each step.

    Args:
        rollout: The rollout.
        before: (N,) sums before the first step.
        discount: Gamma.
    """
    sums = torch.empty_like(rollout.rewards)
    for step in range(len(sums)):
        before = before * ~rollout.starts[step] * discount + rollout.rewards[step]
        sums[step] = before
    return sums
