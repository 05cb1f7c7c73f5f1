"""Towing the fridge's door: how the base moves while the hand holds on to it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from hab_spa.motion.drive import STEP_M, STEP_RAD, angle
from hab_spa.motion.robot import Robot
from hab_spa.shapes import Array
from hab_spa.skills.fridge_door import Door

Free = Callable[[Array], NDArray[np.bool_]]
"""Whether the base may stand at poses (K, 3): (K,)."""


@dataclass(frozen=True, kw_only=True)
class TowConfig:
    """The numbers of towing.

    Attributes:
        ways_m, turns_rad: The base goes so far along a circle, and turns by so much on it.
        count: So many motions of the base are looked at closely ...
        goals: ... from so many arm poses.
        door_m: The middle of the base stays so far from the door.
        distance_m: The hand works best this far from the middle of the base; a metre off that
            counts as `off` metres of the hand's way.
        off: See `distance_m`.
        metre_rad, radian_rad: A metre and a radian of the base take as long as so many radians of
            an arm's joint.
        lag_steps: The base waits so long for the arm's drives.
        gain: Share of its error that a step takes away.
    """

    ways_m: tuple[float, ...] = (-0.7, -0.5, -0.3, -0.15, 0.0, 0.2, 0.4)
    turns_rad: tuple[float, ...] = (-1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5)
    count: int = 6
    goals: int = 5
    door_m: float = 0.32
    distance_m: tuple[float, float] = (0.6, 0.85)
    off: float = 10.0
    metre_rad: float = 3.0
    radian_rad: float = 1.0
    lag_steps: int = 2
    gain: float = 0.3


def tows(
    base: Array, joints: Array, whole: int, door: Door, free: Free, config: TowConfig
) -> Array:
    """Returns motions of the base (T, K, 3) that keep the handle in reach, the best first.

    Args:
        base: Where the robot stands (3,).
        joints: How far the door is open on the way (K,) [rad].
        whole: The motion has to be free for so many of them.
        door: The door.
        free: Where the base may stand.
        config: The numbers.
    """
    pairs = [pair for pair in product(config.ways_m, config.turns_rad) if pair != (0.0, 0.0)]
    ways_m, turns_rad = np.array(pairs).T
    poses = _along_circles(base, ways_m, turns_rad, len(joints))
    is_free = np.all(free(poses[:, :whole].reshape(-1, 3)).reshape(-1, whole), axis=1)
    handles_m = np.stack([door.handle(float(joint))[:2] for joint in joints])
    gaps = np.stack(
        [door.gap_m(poses[:, k, :2], float(joint)) for k, joint in enumerate(joints)], axis=1
    )
    is_free &= np.all(gaps[:, :whole] >= min(config.door_m, gaps[:, 0].min()), axis=1)
    gap_m = handles_m - poses[:, :, :2]
    cosine, sine = np.cos(poses[:, :, 2]), np.sin(poses[:, :, 2])
    ahead_m = cosine * gap_m[..., 0] + sine * gap_m[..., 1]
    left_m = cosine * gap_m[..., 1] - sine * gap_m[..., 0]
    local_m = np.stack((ahead_m, left_m), axis=-1)
    hand_m = np.linalg.norm(np.diff(local_m, axis=1), axis=-1).sum(axis=1)
    low, high = config.distance_m
    distance_m = np.linalg.norm(local_m, axis=-1)
    off_m = np.maximum(low - distance_m, 0.0) + np.maximum(distance_m - high, 0.0)
    cost = hand_m + config.off * off_m.mean(axis=1)
    order = np.argsort(cost, kind="stable")
    return poses[order[is_free[order]][: config.count]]


def _along_circles(base: Array, ways_m: Array, turns_rad: Array, count: int) -> Array:
    """Returns `count` base poses (C, K, 3) along circles of lengths (C,) that turn by (C,)."""
    shares = np.linspace(0.0, 1.0, count)
    yaws = base[2] + turns_rad[:, None] * shares
    middles = (yaws[:, 1:] + yaws[:, :-1]) / 2
    steps = (
        ways_m[:, None, None] / (count - 1) * np.stack((np.cos(middles), np.sin(middles)), axis=-1)
    )
    places = np.concatenate((np.zeros((len(ways_m), 1, 2)), np.cumsum(steps, axis=1)), axis=1)
    return np.concatenate((base[:2] + places, yaws[..., None]), axis=-1)


def with_base(arc: Array, bases: Array, config: TowConfig) -> Array:
    """Returns a path (K, 10) of arm and base in radians of the arm, for its length and timing."""
    scale = (config.metre_rad, config.metre_rad, config.radian_rad)
    return np.concatenate((arc, bases * scale), axis=1)


def without_base(path: Array, config: TowConfig) -> tuple[Array, Array]:
    """Returns the arm poses (K, 7) and base poses (K, 3) of such a path."""
    scale = (config.metre_rad, config.metre_rad, config.radian_rad)
    return path[:, :7], path[:, 7:] / scale


def rolling(robot: Robot, now: Array, soon: Array, config: TowConfig) -> tuple[float, float]:
    """Returns the velocities, as shares, that bring the base from one pose (3,) to the next.

    Args:
        robot: Whose base.
        now: Where it should be at this step ...
        soon: ... and at the next one.
        config: The numbers.
    """
    x, y, yaw = robot.base
    ahead = np.array((np.cos(yaw), np.sin(yaw)))
    way_m = float(ahead @ (soon[:2] - now[:2] + config.gain * (now[:2] - (x, y))))
    turn_rad = angle(soon[2], now[2]) + config.gain * angle(now[2], yaw)
    return _share(way_m / STEP_M), _share(turn_rad / STEP_RAD)


def _share(speed: float) -> float:
    return min(max(speed, -1.0), 1.0)
