"""Recurrent PPO and DD-PPO for hab-tasks: trainer, recipes and trained policies (S App. C).

Every recipe is also an agent, ``hab_ppo:pick_blind``, and so are those that other packages register
as entry points, such as ``hab_ppo:navigator`` of `hab_navigator`. Importing this package does not
load the simulator; creating an agent does.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from hab_ppo.extensions import extensions
from hab_ppo.recipe import FAST, PAPER, EnvConfig, NetworkConfig, PPOConfig, Preset, Recipe
from hab_ppo.recipes import recipe_names

if TYPE_CHECKING:
    from hab_ppo.agent import PolicyAgent
    from hab_tasks.agent import AgentSetup

__all__ = ["FAST", "PAPER", "EnvConfig", "NetworkConfig", "PPOConfig", "Preset", "Recipe"]

POLICY = "policy"
"""The agent of weights of your own: ``hab_ppo:policy`` with the option ``weights``."""


def __getattr__(name: str) -> Any:
    """Returns the factory of a recipe's agent, or of one that is registered."""
    if name in (registered := extensions("agents")):
        return registered[name].load()
    if name != POLICY and name not in recipe_names():
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return partial(_make, name)


def _make(name: str, setup: AgentSetup) -> PolicyAgent:
    from hab_ppo.agent import make_agent  # loads the simulator

    return make_agent(name, setup)


def __dir__() -> list[str]:
    """Lists the agents too, so that `hab-eval` can suggest them."""
    return sorted({*globals(), *__all__, *recipe_names(), *extensions("agents"), POLICY})
