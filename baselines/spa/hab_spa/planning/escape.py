"""Straight-line retreats: the gripper moves along a line, with constant orientation.

After a grasp, the held object is in contact with its support, but a sampling-based planner needs a
start state with some clearance. In a confined space, a retreat also saves the planner the search
for the exit.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hab_spa.planning.collision import ArmCollision
from hab_spa.planning.ik import BatchArm
from hab_spa.planning.rrt import edge_is_free
from hab_spa.shapes import Array


@dataclass(frozen=True, kw_only=True)
class EscapeConfig:
    """Parameters of straight-line retreats.

    Attributes:
        directions: Directions in the base frame (x ahead, z up), in order of preference.
        aside: Additional directions for escaping from contact.
        step_m: Length of a step.
        length_m: Maximum length of an escape from contact.
        retreat_m: Maximum length of a retreat from a confined space.
        retreat_stride: Steps per waypoint of a retreat.
        margins_m: Clearances after an escape; a smaller one only if all directions fail.
        touch_m: Tolerance for pairs in contact at the start, as the orientation varies slightly.
        deeper_m: The same if no other way back is found: a hand that has held a door by its edge is
            within it.
        drift_m: Maximum deviation of the end-effector from the line.
        turn_weight_m: Weight of an orientation error [m/rad].
        resolution_rad: Resolution of collision checks along edges (Euclidean).
    """

    directions: tuple[tuple[float, float, float], ...] = (
        (0.0, 0.0, 1.0),
        (-0.7071, 0.0, 0.7071),
        (-0.97, 0.0, 0.24),
        (-1.0, 0.0, 0.0),
    )
    aside: tuple[tuple[float, float, float], ...] = (
        (-0.5, 0.5, 0.7071),
        (-0.5, -0.5, 0.7071),
        (-0.7071, 0.7071, 0.0),
        (-0.7071, -0.7071, 0.0),
        (0.0, 1.0, 0.0),
        (0.0, -1.0, 0.0),
    )
    step_m: float = 0.01
    length_m: float = 0.20
    retreat_m: float = 0.40
    retreat_stride: int = 4
    margins_m: tuple[float, ...] = (0.02, 0.01, 0.003)
    touch_m: float = 0.004
    deeper_m: float = 0.03
    drift_m: float = 0.01
    turn_weight_m: float = 0.2
    resolution_rad: float = 0.05


def escape(collision: ArmCollision, arm: BatchArm, start: Array, config: EscapeConfig) -> Array:
    """Moves the arm (J,) and the held object out of contact.

    Returns:
        The path (K, J) including the start; only the start (1, J) if it is free already; empty
        (0, J) if no direction succeeds. The margins of `collision` are changed.
    """
    for margin_m in config.margins_m:
        collision.set_margin(margin_m)
        if collision.is_free(start):
            return start[None]
        for direction in (*config.directions, *config.aside):
            path = _out_of_contact(collision, arm, start, direction, margin_m, config)
            if path is not None:
                return path
    return np.zeros((0, len(start)))


def retreats(
    collision: ArmCollision, arm: BatchArm, start: Array, config: EscapeConfig
) -> list[Array]:
    """Returns the collision-free retreats (K, J), K > 1, from an arm pose (J,).

    They keep the current margins of `collision`.
    """
    paths = []
    for direction in config.directions:
        path, last = [start], start
        steps = round(config.retreat_m / config.step_m)
        for i, qpos in enumerate(_line(arm, start, direction, steps, config), start=1):
            # Small steps keep the hand on its line; a planner needs fewer waypoints.
            if i % config.retreat_stride:
                continue
            if not edge_is_free(collision, last, qpos, config.resolution_rad):
                break
            path.append(qpos)
            last = qpos
        if len(path) > 1:
            paths.append(np.array(path))
    return paths


def _out_of_contact(
    collision: ArmCollision,
    arm: BatchArm,
    start: Array,
    direction: tuple[float, float, float],
    margin_m: float,
    config: EscapeConfig,
) -> Array | None:
    path = [start]
    steps = round(config.length_m / config.step_m)
    for qpos in _line(arm, start, direction, steps, config):
        # On the way, contacts of the start may last and nothing else may touch; at the end of it,
        # the full margin counts for all.
        collision.set_margin(0.0)
        collision.relax(start, config.touch_m)
        if not edge_is_free(collision, path[-1], qpos, config.resolution_rad):
            return None
        path.append(qpos)
        collision.set_margin(margin_m)
        if collision.is_free(qpos):
            return np.array(path)
    return None


def _line(
    arm: BatchArm,
    start: Array,
    direction: tuple[float, float, float],
    steps: int,
    config: EscapeConfig,
) -> Iterator[Array]:
    """Yields the arm poses (J,) along a line, as far as the arm can follow it."""
    goal, qpos = arm.ee_pose(start).copy(), start
    for _ in range(steps):
        # From the last goal, not from where the hand has got to: deviations would add up.
        goal[:3, 3] += np.array(direction) * config.step_m
        qpos = arm.track_pose(qpos, goal, steps=3, turn_weight_m=config.turn_weight_m)
        if np.linalg.norm(arm.ee_pose(qpos)[:3, 3] - goal[:3, 3]) > config.drift_m:
            return
        yield qpos
