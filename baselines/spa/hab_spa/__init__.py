"""Sense-plan-act baselines of the Home Assistant Benchmark (S App. D).

Importing this package does not load the simulator; accessing an agent's factory does.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hab_plans.motion import Failure

from hab_tasks.lazy_names import lazy_names

if TYPE_CHECKING:
    from hab_spa.agents.factories import spa_priv
    from hab_spa.agents.seen_agents import spa
    from hab_spa.agents.task_agents import tp_spa, tp_spa_priv

__all__ = ["Failure", "spa", "spa_priv", "tp_spa", "tp_spa_priv"]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "agents.factories": ("spa_priv",),
        "agents.seen_agents": ("spa",),
        "agents.task_agents": ("tp_spa", "tp_spa_priv"),
    },
)
