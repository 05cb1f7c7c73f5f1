"""Rollouts: a vector environment plays each of a list of episodes once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from hab_ppo.network import Policy
from hab_ppo.noise import Noise
from hab_ppo.observation import Observation
from hab_ppo.stages import reached
from hab_tasks.episodes import Episode


@dataclass(frozen=True, kw_only=True)
class Score:
    """Result of an episode.

    Attributes:
        episode: Index in the list.
        success: Whether it succeeded.
        total_reward: Sum of the rewards.
        steps: Number of steps.
        stages: Which stages of a task it reached, in order.
    """

    episode: int
    success: bool
    total_reward: float
    steps: int
    stages: tuple[bool, ...] = ()


class Rows:
    """Which row plays which episode; a row with none left repeats its last one, uncounted.

    Attributes:
        playing: Index of the episode of each row; None without one.
        shown: The episode of each row, also of those that repeat one.
        total, steps: (N,) sum of rewards and number of steps of the running episodes.
    """

    def __init__(self, episodes: Sequence[Episode], rows: int) -> None:
        self._episodes, self._next = episodes, rows
        self.playing = [row if row < len(episodes) else None for row in range(rows)]
        self.shown = [episodes[row % len(episodes)] for row in range(rows)]
        self.total, self.steps = np.zeros(rows), np.zeros(rows, dtype=int)

    def end(self, row: int, success: bool, stages: tuple[bool, ...]) -> Score | None:
        """Starts the next episode in a row; returns the score of the one that ended."""
        number = self.playing[row]
        score = None
        if number is not None:
            score = Score(
                episode=number,
                success=success,
                total_reward=float(self.total[row]),
                steps=int(self.steps[row]),
                stages=stages,
            )
        self.total[row], self.steps[row] = 0.0, 0
        self.playing[row] = None
        if self._next < len(self._episodes):
            self.playing[row], self.shown[row] = self._next, self._episodes[self._next]
            self._next += 1
        return score


class Observer(Protocol):
    """Sees the steps of an evaluation."""

    def before_step(self, playing: Sequence[int | None], obs: Any, seen: Observation) -> None:
        """Sees an observation.

        Args:
            playing: Index of the episode of each row; None without one.
            obs: The environment's observation.
            seen: What the policy reads of it.
        """

    def after_step(self, ended: NDArray[np.bool_]) -> None:
        """Sees which rows' episodes ended, (N,)."""


def evaluate(
    env: Any,
    policy: Policy,
    episodes: Sequence[Episode],
    noise: Noise | None = None,
    observer: Observer | None = None,
    stages: Sequence[str] = (),
) -> list[Score]:
    """Plays each episode once; returns the scores in order.

    Args:
        env: A vector environment in autoreset mode `DISABLED` or `NEXT_STEP`; its rows have to be
            reset afterwards.
        policy: The policy.
        episodes: The episodes.
        noise: Draws the actions, on the policy's device; None for the most likely ones.
        observer: Sees every step.
        stages: Names of the task's stages.
    """
    count, device = env.num_envs, policy.state_normalizer.mean.device
    rows, scores = Rows(episodes, count), []
    obs, _ = env.reset(options={"episode": rows.shown})
    starts, memory = torch.ones(count, dtype=torch.bool), policy.no_memory(count)
    while len(scores) < len(episodes):
        seen = policy.layout.read(obs)
        if observer is not None:
            observer.before_step(rows.playing, obs, seen)
        acted = policy.choose(seen.to(device), memory, starts.to(device), noise)
        memory = acted.memory
        obs, reward, terminated, truncated, info = env.step(policy.head.to_env(acted.actions))
        rows.total += reward
        rows.steps += 1
        ended = terminated | truncated
        if observer is not None:
            observer.after_step(ended)
        there = reached(info, stages)
        for row in np.flatnonzero(ended).tolist():
            score = rows.end(row, bool(info["success"][row]), tuple(there[row].tolist()))
            scores += [] if score is None else [score]
        starts = torch.from_numpy(ended.copy())
        if ended.any() and len(scores) < len(episodes):
            obs, _ = env.reset(options={"reset_mask": ended.copy(), "episode": rows.shown})
    return sorted(scores, key=lambda score: score.episode)
