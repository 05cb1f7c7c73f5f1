"""Recurrent PPO and DD-PPO for hab-tasks: trainer, recipes and trained policies (S App. C).

Every recipe is also an agent, ``hab_ppo:pick_blind``, and so is ``hab_ppo:navigator``. Importing
this package does not load the simulator; creating an agent does.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from hab_ppo.recipe import FAST, PAPER, EnvConfig, NetworkConfig, PPOConfig, Preset, Recipe
from hab_ppo.recipes import recipe_names

if TYPE_CHECKING:
    from hab_ppo.agent import PolicyAgent
    from hab_ppo.navigation.agent import NavigatorAgent
    from hab_ppo.navigation.navigator import Stops
    from hab_tasks.agent import AgentSetup

__all__ = [
    "FAST",
    "PAPER",
    "EnvConfig",
    "NetworkConfig",
    "PPOConfig",
    "Preset",
    "Recipe",
]

NAVIGATORS: dict[str, Stops] = {
    "navigator": "often",
    "navigator_once": "once",
    "navigator_without_stop": "never",
}
"""The agents of `hab_ppo.navigation`, and when they stop: in a task, navigation ends with the first
stop; with a fixed stop (S Fig. 27), arriving is enough."""

POLICY = "policy"
"""The agent of weights of your own: ``hab_ppo:policy`` with the option ``weights``."""


def __getattr__(name: str) -> Any:
    """Returns the factory of a recipe's agent, or of the navigator."""
    if name in NAVIGATORS:
        return partial(_make_navigator, NAVIGATORS[name])
    if name != POLICY and name not in recipe_names():
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return partial(_make, name)


def _make(name: str, setup: AgentSetup) -> PolicyAgent:
    from hab_ppo.agent import make_agent  # loads the simulator

    return make_agent(name, setup)


def _make_navigator(stops: Stops, setup: AgentSetup) -> NavigatorAgent:
    from hab_ppo.navigation.agent import make_agent  # loads the simulator

    return make_agent(setup, stops)


def __dir__() -> list[str]:
    """Lists the agents too, so that `hab-eval` can suggest them."""
    return sorted({*globals(), *__all__, *recipe_names(), *NAVIGATORS, POLICY})
