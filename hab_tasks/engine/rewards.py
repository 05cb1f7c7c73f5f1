"""Reward terms and scores shared by the skills, as in the paper's equations."""

from __future__ import annotations

import numpy as np

from hab_tasks.arrays import Bools, Floats


def force_penalty(force_n: Floats, weight: float, cap: float) -> Floats:
    """Returns -min(weight * C_t, cap), (N,).

    The paper prints ``- max(0.001 C_t, 1.0)``. That penalty is never below 1 and so rewards
    collisions; Habitat's code takes the minimum (docs/deviations.md).
    """
    return -np.minimum(weight * force_n, cap)


def weighted_by_completion_time(
    success: Bools, distance_m: Floats, steps: Floats, ee_step_m: float
) -> Floats:
    """Returns Success * oracle's time / agent's time, at most 1, (N,) (S F.2).

    The oracle's time is 2 * distance / maximum end-effector speed, with the initial distance (N,)
    of the end-effector to its goal and `ee_step_m` per action. The paper prints the inverted
    fraction (docs/deviations.md).
    """
    oracle_steps = 2.0 * distance_m / ee_step_m
    share: Floats = np.minimum(oracle_steps / np.maximum(steps, 1.0), 1.0)
    return success * share


def weighted_by_path(success: Bools, shortest_m: Floats, path_m: Floats) -> Floats:
    """Returns Success * shortest / max(path, shortest), (N,): SPL of point navigation."""
    longest_m = np.maximum(np.maximum(path_m, shortest_m), 1e-6)
    return success * shortest_m / longest_m
