"""Path following by joint targets, with detection of tracking errors and contact (S App. D)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hab_spa.shapes import Array


@dataclass(frozen=True, kw_only=True)
class FollowConfig:
    """Parameters of path following; errors are of the joint that differs most.

    Attributes:
        lag_rad: Maximum tracking error for advancing to the next target.
        lost_rad: Execution fails when the tracking error exceeds this ...
        lost_steps: ... for more than this many steps.
        settled_rad: Tolerance of the final target.
        settle_steps: Maximum steps for settling at the final target.
        air_shares: Model of free motion: share of the distance to the target, plus share of the
            last displacement (the drives of `hab_tasks.robots.control_modes`).
        bump_rad: Deviation from free motion that counts as contact.
    """

    lag_rad: float = 0.25
    lost_rad: float = 0.2
    lost_steps: int = 20
    settled_rad: float = 0.015
    settle_steps: int = 15
    air_shares: tuple[float, float] = (0.33, 0.17)
    bump_rad: float = np.inf


class Follower:
    """Yields the targets (T, 7) of one path, one per control step.

    Attributes:
        bumped: Whether the last displacement of the arm indicates contact.
    """

    def __init__(self, targets: Array, config: FollowConfig) -> None:
        self._targets, self._config = targets, config
        self._index, self._lost_steps, self._end_steps = 0, 0, 0
        self._last: Array | None = None
        self._step: Array | None = None
        self.bumped = False

    @property
    def at_end(self) -> bool:
        """Whether the final target has been issued."""
        return self._index >= len(self._targets)

    @property
    def target(self) -> Array:
        """The latest joint target (7,) [rad]."""
        return self._targets[max(self._index - 1, 0)]

    @property
    def rest(self) -> Array:
        """The remaining joint targets (T, 7) [rad]."""
        return self._targets[self._index :]

    @property
    def way_back(self) -> Array:
        """The past joint targets (T, 7) [rad], latest first."""
        return self._targets[: self._index][::-1]

    def advance(self, qpos: Array) -> Array:
        """Returns the next target (7,) for the current joint positions (7,)."""
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
        """Whether the tracking error was too large for too long."""
        return self._lost_steps > self._config.lost_steps

    def settled(self, qpos: Array) -> bool:
        """Whether the arm (7,) has settled at the end of the path, or its time for that is over."""
        if not self.at_end:
            return False
        near = float(np.abs(qpos - self.target).max()) <= self._config.settled_rad
        return near or self._end_steps >= self._config.settle_steps
