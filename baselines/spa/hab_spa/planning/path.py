"""Time parametrization: joint targets at the control rate from a path in joint space."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hab_spa.shapes import Array


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
    """Returns the joint targets (T, 7), one per control step, along a path (K, 7).

    `pace` multiplies the three limits of the config. The first target is one step from the start,
    the last is the end of the path.
    """
    lengths = np.abs(np.diff(path, axis=0)).max(axis=1)
    config = replace(
        config,
        step_rad=config.step_rad * pace,
        acceleration_rad=config.acceleration_rad * pace,
        corner_rad=config.corner_rad * pace,
    )
    path = path[np.concatenate(([True], lengths > 1e-9))]
    lengths = lengths[lengths > 1e-9]
    if not len(lengths):
        return path[:1]
    knots = np.concatenate(([0.0], np.cumsum(lengths)))
    grid = np.linspace(0.0, knots[-1], max(2, int(np.ceil(knots[-1] / config.grid_rad)) + 1))
    speeds = _speeds(grid, knots, _corner_speeds(path, lengths, config), config)
    steps = np.diff(grid) / (0.5 * (speeds[1:] + speeds[:-1]))
    times = np.concatenate(([0.0], np.cumsum(steps)))
    count = max(1, int(np.ceil(times[-1])))
    along = np.interp(np.linspace(0.0, times[-1], count + 1)[1:], times, grid)
    return np.stack([np.interp(along, knots, path[:, i]) for i in range(path.shape[1])], axis=1)


def _corner_speeds(path: Array, lengths: Array, config: TimingConfig) -> Array:
    """Returns the maximum speed (K,) [rad/step] at each vertex; the motion starts and ends slow."""
    directions = np.diff(path, axis=0) / lengths[:, None]
    jumps = np.abs(np.diff(directions, axis=0)).max(axis=1)
    inner = config.corner_rad / np.maximum(jumps, 1e-6)
    return np.minimum(np.concatenate(([config.corner_rad], inner, [config.corner_rad])),
                      config.step_rad)  # fmt: skip


def _speeds(grid: Array, knots: Array, corner_speeds: Array, config: TimingConfig) -> Array:
    """Returns the speed profile (G,) under the speed limits at the knots and the acceleration."""
    speeds = np.full(len(grid), config.step_rad)
    nearest = np.abs(grid[:, None] - knots[None, :]).argmin(axis=0)
    np.minimum.at(speeds, nearest, corner_speeds)
    gain = 2.0 * config.acceleration_rad * (grid[1] - grid[0])
    for order in (range(1, len(grid)), range(len(grid) - 2, -1, -1)):
        for i in order:
            before = speeds[i - order.step]
            speeds[i] = min(speeds[i], np.sqrt(before**2 + gain))
    return speeds
