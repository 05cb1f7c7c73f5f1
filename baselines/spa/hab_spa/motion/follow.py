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
        air_shares: In free air a joint moves by the first share of its way to the target, plus
            the second of its last step (the drives of `hab_tasks.robots.control_modes`).
        bump_rad: The arm has met with something when a joint moves otherwise by more than this.
    """

    lag_rad: float = 0.25
    lost_rad: float = 0.2
    lost_steps: int = 20
    settled_rad: float = 0.015
    settle_steps: int = 15
    air_shares: tuple[float, float] = (0.33, 0.17)
    bump_rad: float = np.inf


class Follower:
    """Hands out the targets (T, 7) of one path, one a control step.

    Attributes:
        bumped: Whether the arm's last step was not what it would have been in free air.
    """

    def __init__(self, targets: Array, config: FollowConfig) -> None:
        self._targets, self._config = targets, config
        self._index, self._lost_steps, self._end_steps = 0, 0, 0
        self._last: Array | None = None
        self._step: Array | None = None
        self.bumped = False

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

    @property
    def way_back(self) -> Array:
        """The joint targets (T, 7) [rad] handed out so far, the last first."""
        return self._targets[: self._index][::-1]

    def advance(self, qpos: Array) -> Array:
        """Returns the next target (7,), given where the arm (7,) is."""
        self._feel(qpos)
        error = float(np.abs(qpos - self.target).max()) if self._index else 0.0
        self._lost_steps = self._lost_steps + 1 if error > self._config.lost_rad else 0
        if self.at_end:
            self._end_steps += 1
        elif error <= self._config.lag_rad:
            self._index += 1
        return self.target

    def _feel(self, qpos: Array) -> None:
        if self._last is not None:
            step = qpos - self._last
            if self._step is not None:
                pull, swing = self._config.air_shares
                expected = pull * (self.target - self._last) + swing * self._step
                self.bumped = float(np.abs(step - expected).max()) > self._config.bump_rad
            self._step = step
        self._last = qpos.copy()

    def lost(self) -> bool:
        """Whether the arm has not kept up for too long."""
        return self._lost_steps > self._config.lost_steps

    def settled(self, qpos: Array) -> bool:
        """Whether the arm (7,) stands at the end of the path, or has had the time to."""
        if not self.at_end:
            return False
        near = float(np.abs(qpos - self.target).max()) <= self._config.settled_rad
        return near or self._end_steps >= self._config.settle_steps
