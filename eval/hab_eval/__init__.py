"""Evaluation of agents on the Home Assistant Benchmark.

Importing this package does not load the simulator; runs and benchmarks load it when needed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hab_tasks.agent import Agent, AgentSetup

__all__ = ["__version__", "close_hand", "do_nothing", "open_hand", "random_agent", "straight_line"]

__version__ = "0.3.0"


def random_agent(setup: AgentSetup) -> Agent:
    """Returns the built-in baseline: uniform random actions, seeded per episode."""
    from hab_eval.example_agent import RandomAgent

    return RandomAgent(setup)


def do_nothing(setup: AgentSetup) -> Agent:
    """Returns an agent that stands still and keeps holding its object."""
    from hab_eval.standing_agent import StandingAgent

    return StandingAgent(setup, hand="keep")


def close_hand(setup: AgentSetup) -> Agent:
    """Returns an agent that stands still and closes the gripper."""
    from hab_eval.standing_agent import StandingAgent

    return StandingAgent(setup, hand="close")


def open_hand(setup: AgentSetup) -> Agent:
    """Returns an agent that stands still and opens the gripper."""
    from hab_eval.standing_agent import StandingAgent

    return StandingAgent(setup, hand="open")


def straight_line(setup: AgentSetup) -> Agent:
    """Returns an agent of Pick and Place whose hand goes straight to the point and to rest."""
    from hab_eval.straight_agent import StraightAgent

    return StraightAgent(setup)
