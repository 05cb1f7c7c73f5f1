"""Sense-plan-act baselines of the Home Assistant Benchmark (S App. D).

Importing this package does not load the simulator; accessing an agent's factory does.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hab_plans.motion import Failure

from hab_tasks.registration import names_on_demand

if TYPE_CHECKING:
    from hab_spa.agents.skill_agents import spa, spa_priv
    from hab_spa.agents.task_agents import tp_spa_priv

__all__ = ["Failure", "spa", "spa_priv", "tp_spa_priv"]

__getattr__, __dir__ = names_on_demand(
    __name__,
    {
        "agents.skill_agents": ("spa", "spa_priv"),
        "agents.task_agents": ("tp_spa_priv",),
    },
)
