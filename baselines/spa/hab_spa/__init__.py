"""Sense-plan-act baselines of the Home Assistant Benchmark (S App. D)."""

from hab_spa.factories import spa_priv
from hab_spa.results import Failure
from hab_spa.seen_agents import spa
from hab_spa.task_agents import tp_spa, tp_spa_priv

__all__ = ["Failure", "spa", "spa_priv", "tp_spa", "tp_spa_priv"]
