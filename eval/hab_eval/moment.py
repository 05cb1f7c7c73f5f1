"""What observers of a rollout are told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Moment:
    """What is known after a step, and before the first one.

    Attributes:
        step: Steps taken.
        info: What the environment told last.
        doing: What the agent says that it is doing.
        reward: Reward of the last step.
        episode_return: Sum of the rewards so far.
    """

    step: int
    info: Mapping[str, Any]
    doing: str
    reward: float
    episode_return: float
