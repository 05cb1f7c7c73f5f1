"""Policies in vector environments: the rows, what they report, and the episodes of a policy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import torch
from hab_eval.run.environments import gripper_entry
from numpy.typing import NDArray
from torch import Tensor

from hab_ppo.actions import Noise
from hab_ppo.network import Policy
from hab_ppo.observation import Observation
from hab_ppo.recipe import EnvConfig, Recipe
from hab_tasks.engine.rollout import Job, Outcome, VectorRows, play
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
    entry = gripper_entry(imported_id(recipe.env.reference), recipe.env.control_mode)
    return () if entry is None else (entry,)


def stage_names(env: EnvConfig) -> tuple[str, ...]:
    """Returns the names of a task's stages, in order; () for a skill (S App. I.2, Fig. 26)."""
    found = ENVS[imported_id(env.reference)].env
    return tuple(found.task.stages) if issubclass(found, TaskEnv) else ()


def info_keys(env: EnvConfig) -> tuple[str, ...]:
    """Returns the entries of `info` that a run needs."""
    return ("success", "stages") if stage_names(env) else ("success",)


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
