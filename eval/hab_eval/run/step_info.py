"""The information that rollout observers receive."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, kw_only=True)
class StepInfo:
    """State of an episode after a reset or a step.

    Attributes:
        step: Steps taken.
        info: The latest `info` of the environment.
        doing: The agent's current activity (`AgentReport.doing`).
        reward: Reward of the last step.
        episode_return: Sum of the rewards so far.
    """

    step: int
    info: Mapping[str, Any]
    doing: str
    reward: float
    episode_return: float
