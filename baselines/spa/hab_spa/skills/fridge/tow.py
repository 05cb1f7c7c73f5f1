"""Base motions during a pull of the fridge door."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from hab_spa.motion.drive import angle
from hab_spa.motion.robot import Robot
from hab_spa.shapes import Array
from hab_spa.skills.fridge.door import Door

Free = Callable[[Array], NDArray[np.bool_]]
"""Base poses (K, 3) -> whether each is allowed (K,)."""


@dataclass(frozen=True, kw_only=True)
class TowConfig:
    """Parameters of base motion during a pull.

    Attributes:
        lengths_m, turns_rad: Candidate arc lengths and rotations of circular base motions.
        count: Maximum number of base motions evaluated ...
        goals: ... each with this many grasp poses.
        door_m: Minimum distance of the base's center from the door.
        distance_m: Preferred range of the hand's distance from the base's center.
        off: Cost of a metre outside this range, in metres of hand motion.
        metre_rad, radian_rad: Joint displacements that take as long as a metre and a radian of
            base motion.
        lag_steps: Delay of the base, which compensates for the lag of the arm's drives.
        gain: Share of the position error corrected per step.
    """

    lengths_m: tuple[float, ...] = (-0.7, -0.5, -0.3, -0.15, 0.0, 0.2, 0.4)
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
    base: Array, joints: Array, required: int, door: Door, free: Free, config: TowConfig
) -> Array:
    """Returns base motions (T, K, 3) that keep the handle within reach, best first.

    Args:
        base: Initial base pose (3,).
        joints: Joint positions of the door (K,) [rad].
        required: Number of leading base poses that must be allowed.
        door: The door.
        free: Function that returns which base poses are allowed.
        config: Parameters.
    """
    pairs = [pair for pair in product(config.lengths_m, config.turns_rad) if pair != (0.0, 0.0)]
    lengths_m, turns_rad = np.array(pairs).T
    poses = _along_circles(base, lengths_m, turns_rad, len(joints))
    is_free = np.all(free(poses[:, :required].reshape(-1, 3)).reshape(-1, required), axis=1)
    handles_m = np.stack([door.handle(float(joint))[:2] for joint in joints])
    gaps = np.stack(
        [door.gap_m(poses[:, k, :2], float(joint)) for k, joint in enumerate(joints)], axis=1
    )
    is_free &= np.all(gaps[:, :required] >= min(config.door_m, gaps[:, 0].min()), axis=1)
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


def _along_circles(base: Array, lengths_m: Array, turns_rad: Array, count: int) -> Array:
    """Returns `count` base poses (C, K, 3) on circular arcs of lengths (C,) and rotations (C,)."""
    shares = np.linspace(0.0, 1.0, count)
    yaws = base[2] + turns_rad[:, None] * shares
    middles = (yaws[:, 1:] + yaws[:, :-1]) / 2
    directions = np.stack((np.cos(middles), np.sin(middles)), axis=-1)
    steps = lengths_m[:, None, None] / (count - 1) * directions
    offsets = np.concatenate((np.zeros((len(lengths_m), 1, 2)), np.cumsum(steps, axis=1)), axis=1)
    return np.concatenate((base[:2] + offsets, yaws[..., None]), axis=-1)


def with_base(arc: Array, bases: Array, config: TowConfig) -> Array:
    """Returns the joint path (K, 10) of arm and base, scaled to radians of the arm for timing."""
    scale = (config.metre_rad, config.metre_rad, config.radian_rad)
    return np.concatenate((arc, bases * scale), axis=1)


def without_base(path: Array, config: TowConfig) -> tuple[Array, Array]:
    """Splits a path of `with_base` into arm poses (K, J) and base poses (K, 3)."""
    scale = (config.metre_rad, config.metre_rad, config.radian_rad)
    return path[:, :-3], path[:, -3:] / scale


def rolling(robot: Robot, now: Array, soon: Array, config: TowConfig) -> tuple[float, float]:
    """Returns the relative velocities that move the base from one pose (3,) to the next.

    Args:
        robot: The robot.
        now: Reference pose at this step.
        soon: Reference pose at the next step.
        config: Parameters.
    """
    x, y, yaw = robot.base
    ahead = np.array((np.cos(yaw), np.sin(yaw)))
    distance_m = float(ahead @ (soon[:2] - now[:2] + config.gain * (now[:2] - (x, y))))
    turn_rad = angle(soon[2], now[2]) + config.gain * angle(now[2], yaw)
    most = robot.spec.base_step_m, robot.spec.base_step_rad
    return _share(distance_m / most[0]), _share(turn_rad / most[1])


def _share(speed: float) -> float:
    return min(max(speed, -1.0), 1.0)
