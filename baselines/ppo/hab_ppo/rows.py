"""Vector environments of policies."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
from hab_eval.run.environments import gripper_entry

from hab_ppo.recipe import EnvConfig, Recipe


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
    entry = gripper_entry(recipe.env.control_mode)
    return () if entry is None else (entry,)
