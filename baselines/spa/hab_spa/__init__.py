"""Sense-plan-act baselines of the Home Assistant Benchmark (S App. D)."""

from hab_spa.agents.factories import spa_priv
from hab_spa.agents.seen_agents import spa
from hab_spa.agents.task_agents import tp_spa, tp_spa_priv
from hab_spa.results import Failure

__all__ = ["Failure", "spa", "spa_priv", "tp_spa", "tp_spa_priv"]
