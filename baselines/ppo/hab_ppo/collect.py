"""Collecting rollouts in a vector environment."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from hab_ppo.actions import ActionNoise
from hab_ppo.distributed import Ranks
from hab_ppo.network import Policy
from hab_ppo.observation import Observation
from hab_ppo.rollout import Rollout
from hab_ppo.rows import VectorRows
from hab_tasks.engine.rollout import Outcome

EPISODE_SUMS = ("episodes", "successes", "return", "length")
"""Sums over finished episodes; how many of them reached each stage of a task follows."""


class Clock:
    """Seconds spent in named parts of the loop.

    Attributes:
        seconds: Part -> seconds.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def __call__(self, part: str) -> Iterator[None]:
        """Adds the time inside the context to a part."""
        began = time.perf_counter()
        try:
            yield
        finally:
            spent = time.perf_counter() - began
            self.seconds[part] = self.seconds.get(part, 0.0) + spent


class Collector:
    """Plays the rows of this rank; episodes continue from one rollout to the next.

    Attributes:
        env: The vector environment, in autoreset mode `NEXT_STEP`.
        clock: Seconds in ``env`` and ``inference``.
    """

    def __init__(
        self,
        env: Any,
        policy: Policy,
        ranks: Ranks,
        steps: int,
        correlation: float = 0.0,
        stages: Sequence[str] = (),
    ) -> None:
        """Creates a collector.

        Args:
            env: The vector environment.
            policy: The policy.
            ranks: The ranks of the run.
            steps: Steps of a rollout in each row.
            correlation: Correlation of the noise of successive steps.
            stages: Names of the task's stages.
        """
        self.env, self.clock, self._stages = env, Clock(), stages
        self._policy, self._ranks, self._steps = policy, ranks, steps
        self._correlation = correlation
        self._obs: Observation | None = None

    def reset(self, seeds: list[int]) -> None:
        """Starts new episodes in all rows, in simulations built anew."""
        self._rows = VectorRows(self.env, seeds)
        self._obs = self._policy.layout.read(self._rows.observe())
        self._memory = self._policy.no_memory(self._rows.count)

    def collect(self, update: int, generator: torch.Generator) -> tuple[Rollout, Tensor]:
        """Plays a rollout, with actions drawn from `generator`.

        Returns:
            The rollout, and `EPISODE_SUMS` (4 + S,) over the episodes that ended in it.
        """
        policy, rows = self._policy, self._rows
        noise = ActionNoise(generator, self._correlation)
        rollout = Rollout.empty(
            self._steps, rows.count, policy.layout, policy.head.stored, policy.config.lstm_size
        )
        # The update unrolls the LSTM from here, and learns through this rollout only.
        rollout.memory = self._memory
        sums = np.zeros(len(EPISODE_SUMS) + len(self._stages))
        step = 0
        while step < self._steps and not self._ranks.preempts(update, step, self._steps):
            with self.clock("inference"):
                obs = self._seen
                acted = policy.act(*self._inputs, noise)
                actions = policy.head.to_env(acted.actions)
                rollout.put(step, obs)
                rollout.starts[step] = torch.from_numpy(rows.fresh)
                rollout.valid[step] = torch.from_numpy(~rows.over)
                rollout.actions[step], rollout.values[step] = acted.actions, acted.values
                rollout.log_probs[step], self._memory = acted.log_probs, acted.memory
            with self.clock("env"):
                ended = rows.step(actions, range(rows.count))
            with self.clock("inference"):
                sums += self._sums(list(ended.values()))
                self._obs = policy.layout.read(rows.observe())
                reward, terminated, truncated = rows.last
                rollout.rewards[step] = torch.from_numpy(np.asarray(reward, np.float32))
                rollout.terminated[step] = torch.from_numpy(terminated)
                # A step can be both; an episode that has ended for good has no
                # value to bootstrap from.
                rollout.truncated[step] = torch.from_numpy(truncated & ~terminated)
            step += 1
        if step == self._steps:
            self._ranks.finish_rollout(update)
        rollout.last_values = policy.values(*self._inputs)
        return rollout.first(step).to(self._ranks.device), torch.from_numpy(sums)

    @property
    def _seen(self) -> Observation:
        assert self._obs is not None, "call reset first"
        return self._obs

    @property
    def _inputs(self) -> tuple[Observation, Tensor, Tensor]:
        """Observations, memory and starts of episodes, on the policy's device."""
        device = self._ranks.device
        starts = torch.from_numpy(self._rows.fresh)
        return self._seen.to(device), self._memory, starts.to(device)

    def _sums(self, outcomes: Sequence[Outcome]) -> NDArray[np.float64]:
        """Returns the sums over the episodes that a step has ended."""
        values = [
            (1, one.success, one.episode_return, one.steps, *map(one.stages.get, self._stages))
            for one in outcomes
        ]
        size = len(EPISODE_SUMS) + len(self._stages)
        return np.array(values, dtype=float).reshape(-1, size).T.copy().sum(axis=1)
