"""Evaluation of agents on the Home Assistant Benchmark.

Importing this package is light: the simulator is loaded only when a run or a bench needs it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hab_tasks.agent import Agent, AgentSetup

__all__ = ["__version__", "random_agent"]

__version__ = "0.1.0"


def random_agent(setup: AgentSetup) -> Agent:
    """Returns the built-in baseline: uniform random actions from each episode's own seed."""
    from hab_eval.example_agent import RandomAgent  # the agent's types live in hab_tasks

    return RandomAgent(setup)
