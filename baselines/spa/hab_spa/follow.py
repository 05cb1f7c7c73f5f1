"""Execution: joint targets one after the other, and whether the arm keeps up (S App. D)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hab_spa.shapes import Array


@dataclass(frozen=True, kw_only=True)
class FollowConfig:
    """When a target is due, and when the arm counts as not following.

    Attributes:
        lag_rad: The next target waits while some joint is farther than this from the current one.
        lost_rad: Execution fails when a joint is farther than this from its target, ...
        lost_steps: ... for more than this many steps.
        settled_rad: The end is reached when every joint is this near to it.
        settle_steps: How long the arm may take to settle there.
    """

    lag_rad: float = 0.25
    lost_rad: float = 0.2
    lost_steps: int = 20
    settled_rad: float = 0.015
    settle_steps: int = 15


class Follower:
    """Hands out the targets (T, 7) of one path, one a control step."""

    def __init__(self, targets: Array, config: FollowConfig) -> None:
        self._targets, self._config = targets, config
        self._index, self._lost_steps, self._end_steps = 0, 0, 0

    @property
    def at_end(self) -> bool:
        """Whether the last target has been handed out."""
        return self._index >= len(self._targets)

    @property
    def target(self) -> Array:
        """The joint target (7,) [rad] handed out last."""
        return self._targets[max(self._index - 1, 0)]

    @property
    def rest(self) -> Array:
        """The joint targets (T, 7) [rad] that are left."""
        return self._targets[self._index :]

    def advance(self, qpos: Array) -> Array:
        """Returns the next target (7,), given where the arm (7,) is."""
        error = float(np.abs(qpos - self.target).max()) if self._index else 0.0
        self._lost_steps = self._lost_steps + 1 if error > self._config.lost_rad else 0
        if self.at_end:
            self._end_steps += 1
        elif error <= self._config.lag_rad:
            self._index += 1
        return self.target

    def lost(self) -> bool:
        """Whether the arm has not kept up for too long."""
        return self._lost_steps > self._config.lost_steps

    def settled(self, qpos: Array) -> bool:
        """Whether the arm (7,) stands at the end of the path, or has had the time to."""
        if not self.at_end:
            return False
        near = float(np.abs(qpos - self.target).max()) <= self._config.settled_rad
        return near or self._end_steps >= self._config.settle_steps
