"""SPA-Priv: the sense-plan-act baseline of the Home Assistant Benchmark (S App. D)."""

from hab_spa.agent import SpaPrivAgent, spa_priv
from hab_spa.results import Failure

__all__ = ["Failure", "SpaPrivAgent", "spa_priv"]
