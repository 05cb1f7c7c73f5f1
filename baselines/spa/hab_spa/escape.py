"""Leaving contact after a grasp: the held object starts in contact with what it stands on.

A sampling planner needs a start that is free with some clearance. The gripper therefore first
moves straight, in small steps and without turning, until nothing is close.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hab_spa.collision import ArmCollision
from hab_spa.ik import BatchArm
from hab_spa.shapes import Array


@dataclass(frozen=True, kw_only=True)
class EscapeConfig:
    """The escape's numbers.

    Attributes:
        directions: Directions in the base frame (x ahead, z up), tried in this order.
        step_m: Length of a step.
        length_m: Longest escape.
        margins_m: Wanted clearances at the end; a smaller one is used when all directions fail.
        touch_m: Shapes in contact at the start may come this much closer: the arm turns slightly.
        drift_m: The end-effector may miss its straight line by this much.
        turn_weight_m: What a radian of turn is worth beside a metre of position error.
    """

    directions: tuple[tuple[float, float, float], ...] = (
        (0.0, 0.0, 1.0),
        (-0.7071, 0.0, 0.7071),
        (-1.0, 0.0, 0.0),
        (-0.97, 0.0, 0.24),
    )
    step_m: float = 0.01
    length_m: float = 0.20
    margins_m: tuple[float, ...] = (0.02, 0.01, 0.003)
    touch_m: float = 0.004
    drift_m: float = 0.01
    turn_weight_m: float = 0.2


def escape(collision: ArmCollision, arm: BatchArm, start: Array, config: EscapeConfig) -> Array:
    """Moves the arm (7,) away from what it or the held object touches.

    Returns:
        The path (K, 7) from the start on; only the start (1, 7) if it is free already; empty
        (0, 7) if no direction leads out. Margins of `collision` are left at the ones reached.
    """
    for margin_m in config.margins_m:
        collision.set_margin(margin_m)
        if collision.is_free(start):
            return start[None]
        for direction in config.directions:
            path = _straight(collision, arm, start, np.array(direction), margin_m, config)
            if path is not None:
                return path
    return np.zeros((0, 7))


def _straight(
    collision: ArmCollision,
    arm: BatchArm,
    start: Array,
    direction: Array,
    margin_m: float,
    config: EscapeConfig,
) -> Array | None:
    goal = arm.ee_pose(start).copy()
    line_start_m = goal[:3, 3].copy()
    path = [start]
    for i in range(1, round(config.length_m / config.step_m) + 1):
        goal[:3, 3] = line_start_m + direction * (i * config.step_m)
        qpos = arm.track_pose(path[-1], goal, steps=3, turn_weight_m=config.turn_weight_m)
        if np.linalg.norm(arm.ee_pose(qpos)[:3, 3] - goal[:3, 3]) > config.drift_m:
            return None
        collision.set_margin(0.0)
        collision.relax(start, config.touch_m)
        if not collision.is_free(qpos):
            return None
        path.append(qpos)
        collision.set_margin(margin_m)
        if collision.is_free(qpos):
            return np.array(path)
    return None
