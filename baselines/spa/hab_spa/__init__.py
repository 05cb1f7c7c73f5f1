"""Sense-plan-act baselines of the Home Assistant Benchmark (S App. D).

Importing this package does not load the simulator; accessing an agent's factory does.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from hab_plans.motion import Failure

if TYPE_CHECKING:
    from hab_spa.agents.factories import spa_priv
    from hab_spa.agents.seen_agents import spa
    from hab_spa.agents.task_agents import tp_spa, tp_spa_priv

__all__ = ["Failure", "spa", "spa_priv", "tp_spa", "tp_spa_priv"]

_FACTORIES = {
    "spa": "seen_agents",
    "spa_priv": "factories",
    "tp_spa": "task_agents",
    "tp_spa_priv": "task_agents",
}
"""Agent factory -> module."""


def __getattr__(name: str) -> Any:
    """Loads the module of a factory, and with it the simulator, on first access."""
    if name not in _FACTORIES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"hab_spa.agents.{_FACTORIES[name]}"), name)


def __dir__() -> list[str]:
    """Lists the factories too, so that `hab-eval` can suggest them."""
    return sorted({*globals(), *__all__})
