"""Vector environments of policies."""

from __future__ import annotations

from typing import Any

import gymnasium as gym

from hab_ppo.recipe import EnvConfig


def policy_rows(config: EnvConfig, **options: Any) -> Any:
    """Returns a vector environment with the actions of a policy.

    Args:
        config: The policy's environment.
        options: Options of `gymnasium.make_vec`.
    """
    repeat = config.action_repeat
    return gym.make_vec(config.reference, copy=False, action_repeat=repeat, **options)
