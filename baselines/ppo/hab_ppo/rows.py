"""Policies in vector environments: the rows, what they report, and the episodes of a policy."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from hab_eval.run.environments import gripper_entry
from numpy.typing import NDArray
from torch import Tensor

from hab_ppo.actions import Noise
from hab_ppo.network import Policy
from hab_ppo.observation import Observation
from hab_ppo.recipe import EnvConfig, Recipe
from hab_tasks.engine.rollout import Job, Outcome, play
from hab_tasks.envs import ENVS
from hab_tasks.episodes import Episode
from hab_tasks.registration import imported_id
from hab_tasks.tasks.task_env import TaskEnv


def policy_rows(config: EnvConfig, **options: Any) -> Any:
    """Returns a vector environment with the actions of a policy.

    Args:
        config: The policy's environment.
        options: Options of `gymnasium.make_vec`.
    """
    repeat = config.action_repeat
    return gym.make_vec(config.reference, copy=False, action_repeat=repeat, **options)


def binary_entries(recipe: Recipe) -> tuple[int, ...]:
    """Returns the indices of the binary entries of the action: the gripper's, or none."""
    if recipe.preset.network.gripper_persistence is None:
        return ()
    env = recipe.env
    entry = gripper_entry(imported_id(env.reference), env.control_mode, env.robot)
    return () if entry is None else (entry,)


def stage_names(env: EnvConfig) -> tuple[str, ...]:
    """Returns the names of a task's stages, in order; () for a skill (S App. I.2, Fig. 26)."""
    found = ENVS[imported_id(env.reference)].env
    return tuple(found.task.stages) if issubclass(found, TaskEnv) else ()


def info_keys(env: EnvConfig) -> tuple[str, ...]:
    """Returns the entries of `info` that a run needs."""
    return ("success", "stages") if stage_names(env) else ("success",)


class VectorRows:
    """Rows of a vector environment, which step together.

    With seeds the environment chooses the episodes, and its autoreset mode `NEXT_STEP` starts
    them: a row whose episode is over shows its last observation for one more step. Without seeds
    the jobs have the episodes, and a row starts the next one at once; a row without a job repeats
    its last episode, uncounted.

    Attributes:
        count: Number of rows.
        fresh: (N,) bool, rows that show the first observation of an episode.
        over: (N,) bool, rows that show the last observation of one.
        last: (N,) reward, terminated and truncated of the last step.
    """

    def __init__(self, env: Any, seeds: Sequence[int] | None = None) -> None:
        """Takes an environment in autoreset mode `NEXT_STEP`, without seeds also `DISABLED`.

        Its rows have to be reset afterwards.
        """
        self._env, self._seeds, self._obs = env, seeds, None
        self.count: int = env.num_envs
        self.fresh, self.over = np.ones(self.count, dtype=bool), np.zeros(self.count, dtype=bool)
        self._shown: list[Any] = []
        self._return, self._steps = np.zeros(self.count), np.zeros(self.count, dtype=int)

    def start(self, jobs: Mapping[int, Job]) -> None:
        """See `Rows`."""
        episodes = [job.episode for job in jobs.values()]
        self._shown = self._shown or [episodes[n % len(episodes)] for n in range(self.count)]
        for row, job in jobs.items():
            self._shown[row] = job.episode

    def observe(self) -> Any:
        """See `Rows`."""
        if self._obs is None and self._seeds is not None:
            options = {"reconfigure": True}
            self._obs, _ = self._env.reset(seed=list(self._seeds), options=options)
        elif self._obs is None:
            self._obs, _ = self._env.reset(options={"episode": self._shown})
        elif self._seeds is None and self.over.any():
            options = {"reset_mask": self.over, "episode": self._shown}
            self._obs, _ = self._env.reset(options=options)
            self.fresh, self.over = self.over, np.zeros(self.count, dtype=bool)
        return self._obs

    def step(self, actions: Any, rows: Collection[int]) -> dict[int, Outcome]:
        """See `Rows`."""
        self._obs, *self.last, info = self._env.step(actions)
        reward, terminated, truncated = self.last
        self._return[self.fresh], self._steps[self.fresh] = 0.0, 0
        self._return += reward
        self._steps += ~self.over
        self.fresh, self.over = self.over, terminated | truncated
        return {
            row: Outcome.of(
                info, row, steps=int(self._steps[row]), episode_return=float(self._return[row])
            )
            for row in np.flatnonzero(self.over).tolist()
            if row in rows
        }

    def abort(self) -> None:
        """Does nothing: the rows have no observers."""


class Student:
    """A policy that acts in the rows of a vector environment."""

    def __init__(self, policy: Policy, rows: VectorRows, noise: Noise | None) -> None:
        """Acts in `rows`; `noise` draws the actions, None takes the most likely ones."""
        self.policy, self.rows, self._noise = policy, rows, noise
        self._memory = policy.no_memory(rows.count)

    def reset(self, mask: Tensor, seeds: Sequence[int]) -> None:
        """Does nothing: the rows know which observations are the first of an episode."""

    def act(self, obs: Any) -> NDArray[Any]:
        """Returns actions as the environment takes them, (N, ...)."""
        return self.choose(self.policy.layout.read(obs))

    def choose(self, seen: Observation) -> NDArray[Any]:
        """Returns the actions for what the policy reads of an observation."""
        device = self.policy.state_normalizer.mean.device
        starts = torch.from_numpy(self.rows.fresh).to(device)
        acted = self.policy.choose(seen.to(device), self._memory, starts, self._noise)
        self._memory = acted.memory
        return self.policy.head.to_env(acted.actions)


def evaluate(
    env: Any, policy: Policy, episodes: Sequence[Episode], noise: Noise | None = None
) -> list[Outcome]:
    """Plays each episode once; returns their outcomes in order.

    Args:
        env: A vector environment in autoreset mode `DISABLED` or `NEXT_STEP`; its rows have to be
            reset afterwards.
        policy: The policy.
        episodes: The episodes.
        noise: Draws the actions, on the policy's device; None for the most likely ones.
    """
    rows = VectorRows(env)
    jobs = map(Job, range(len(episodes)), episodes)
    found = {one.job.index: one.outcome for one in play(rows, Student(policy, rows, noise), jobs)}
    return [outcome for _, outcome in sorted(found.items())]
