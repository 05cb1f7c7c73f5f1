"""Path following by timed joint targets; detects tracking errors and contact (S App. D)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hab_spa.shapes import Array
from hab_tasks.constants import TARGET_STEP_RAD


@dataclass(frozen=True, kw_only=True)
class TimingConfig:
    """Limits of the motion, in joint space and per control step (1/30 s).

    Attributes:
        step_rad: Maximum joint displacement per step.
        acceleration_rad: Maximum change of the speed along the path [rad/step] per step.
        corner_rad: Maximum jump of a joint's speed [rad/step] at a corner; the joint drives lag by
            about three steps and would cut a fast corner.
        grid_rad: Resolution of the speed profile along the path.
        paces: Multiples of the limits, for use when time is short.
    """

    step_rad: float = 0.05
    acceleration_rad: float = 0.008
    corner_rad: float = 0.02
    grid_rad: float = 0.005
    paces: tuple[float, ...] = (1.0, 1.3, 1.6)


def time_path_within(path: Array, steps: int, config: TimingConfig) -> Array:
    """Returns `time_path` at the slowest pace of the config that takes at most `steps`.

    If there is none, the fastest pace is used.
    """
    targets = path
    for pace in config.paces:
        targets = time_path(path, config, pace)
        if len(targets) <= steps:
            break
    return targets


def time_path(path: Array, config: TimingConfig, pace: float = 1.0) -> Array:
    """Returns the joint targets (T, J), one per control step, along a path (K, J).

    `pace` multiplies the three limits of the config, up to the controller's step. The first target
    is one step from the start, the last is the end of the path.
    """
    lengths = np.abs(np.diff(path, axis=0)).max(axis=1)
    config = replace(
        config,
        step_rad=min(config.step_rad * pace, TARGET_STEP_RAD),
        acceleration_rad=config.acceleration_rad * pace,
        corner_rad=config.corner_rad * pace,
    )
    # A pose that repeats makes an edge without direction.
    path = path[np.concatenate(([True], lengths > 1e-9))]
    lengths = lengths[lengths > 1e-9]
    if not len(lengths):
        return path[:1]
    knots = np.concatenate(([0.0], np.cumsum(lengths)))
    grid = np.linspace(0.0, knots[-1], max(2, int(np.ceil(knots[-1] / config.grid_rad)) + 1))
    speeds = _speeds(grid, knots, _corner_speeds(path, lengths, config), config)
    steps = np.diff(grid) / (0.5 * (speeds[1:] + speeds[:-1]))
    times = np.concatenate(([0.0], np.cumsum(steps)))
    # Rounded up to whole steps, which keeps the speeds below their limits.
    count = max(1, int(np.ceil(times[-1])))
    along = np.interp(np.linspace(0.0, times[-1], count + 1)[1:], times, grid)
    return np.stack([np.interp(along, knots, path[:, i]) for i in range(path.shape[1])], axis=1)


def _corner_speeds(path: Array, lengths: Array, config: TimingConfig) -> Array:
    """Returns the maximum speed (K,) [rad/step] at each vertex; the motion starts and ends slow."""
    directions = np.diff(path, axis=0) / lengths[:, None]
    jumps = np.abs(np.diff(directions, axis=0)).max(axis=1)
    # A joint's speed jumps by that of the path times the change of direction.
    inner = config.corner_rad / np.maximum(jumps, 1e-6)
    return np.minimum(np.concatenate(([config.corner_rad], inner, [config.corner_rad])),
                      config.step_rad)  # fmt: skip


def _speeds(grid: Array, knots: Array, corner_speeds: Array, config: TimingConfig) -> Array:
    """Returns the speed profile (G,) under the speed limits at the knots and the acceleration."""
    speeds = np.full(len(grid), config.step_rad)
    nearest = np.abs(grid[:, None] - knots[None, :]).argmin(axis=0)
    np.minimum.at(speeds, nearest, corner_speeds)
    # v^2 grows by 2 a s over a cell of the grid.
    gain = 2.0 * config.acceleration_rad * (grid[1] - grid[0])
    # Forwards the acceleration limits the speeds, backwards the braking.
    for order in (range(1, len(grid)), range(len(grid) - 2, -1, -1)):
        for i in order:
            before = speeds[i - order.step]
            speeds[i] = min(speeds[i], np.sqrt(before**2 + gain))
    return speeds


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
        bump_rad: Deviation from free motion that counts as contact, ...
        bump_share: ... more by this share of an expected change of the displacement.
    """

    lag_rad: float = 0.25
    lost_rad: float = 0.2
    lost_steps: int = 20
    settled_rad: float = 0.015
    settle_steps: int = 15
    air_shares: tuple[float, float] = (0.33, 0.17)
    bump_rad: float = np.inf
    bump_share: float = 0.3


def tracked(targets: Array, start: Array, config: FollowConfig) -> Array:
    """Returns the arm poses (T, J) in free motion from rest at `start` (J,) by targets (T, J)."""
    poses, last = [start], np.zeros_like(start)
    for target in targets:
        last = _free_step(target, poses[-1], last, config)
        poses.append(poses[-1] + last)
    return np.array(poses[1:])


def _free_step(target: Array, pose: Array, last: Array, config: FollowConfig) -> Array:
    """Returns the next displacement (J,) in free motion, after the displacement `last`."""
    pull, swing = config.air_shares
    return pull * (target - pose) + swing * last


class Follower:
    """Yields the targets (T, J) of one path, one per control step.

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
        """The latest joint target (J,) [rad]."""
        return self._targets[max(self._index - 1, 0)]

    @property
    def rest(self) -> Array:
        """The remaining joint targets (T, J) [rad]."""
        return self._targets[self._index :]

    def advance(self, qpos: Array) -> Array:
        """Returns the next target (J,) for the current joint positions (J,)."""
        self._feel(qpos)
        error = float(np.abs(qpos - self.target).max()) if self._index else 0.0
        self._lost_steps = self._lost_steps + 1 if error > self._config.lost_rad else 0
        if self.at_end:
            self._end_steps += 1
        # Targets far ahead of the arm would make it cut the corners between them.
        elif error <= self._config.lag_rad:
            self._index += 1
        return self.target

    def _feel(self, qpos: Array) -> None:
        if self._last is not None:
            step = qpos - self._last
            if self._step is not None:
                expected = _free_step(self.target, self._last, self._step, self._config)
                change = float(np.abs(expected - self._step).max())
                least = self._config.bump_rad + self._config.bump_share * change
                self.bumped = float(np.abs(step - expected).max()) > least
            self._step = step
        self._last = qpos.copy()

    def lost(self) -> bool:
        """Whether the tracking error was too large for too long."""
        return self._lost_steps > self._config.lost_steps

    def settled(self, qpos: Array) -> bool:
        """Whether the arm (J,) has settled at the end of the path, or its time for that is over."""
        if not self.at_end:
            return False
        near = float(np.abs(qpos - self.target).max()) <= self._config.settled_rad
        return near or self._end_steps >= self._config.settle_steps
