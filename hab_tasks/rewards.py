"""Reward terms and scores that skills share, as the paper's equations have them."""

from __future__ import annotations

from functools import reduce
from operator import add

from hab_tasks.arrays import Rows, maximum, minimum
from hab_tasks.constants import EE_STEP_M


def force_penalty(force_n: Rows, weight: float, cap: float) -> Rows:
    """Returns -min(weight * C_t, cap), (N,).

    The paper prints ``- max(0.001 C_t, 1.0)``; a penalty that is never below 1 rewards hitting
    things, and Habitat's code takes the minimum (docs/deviations.md).
    """
    return -minimum(weight * force_n, cap)


def total(terms: dict[str, Rows]) -> Rows:
    """Returns the sum of the terms, (N,)."""
    return reduce(add, terms.values())


def weighted_by_completion_time(success: Rows, distance_m: Rows, steps: Rows) -> Rows:
    """Returns Success * oracle's time / agent's time, at most 1, (N,) (S F.2).

    The oracle's time is 2 * distance / largest speed of the end-effector. The paper prints the
    fraction upside down (docs/deviations.md).

    Args:
        success: (N,) bool.
        distance_m: (N,) from the end-effector to its goal when the episode began.
        steps: (N,) actions until now.
    """
    oracle_steps = 2.0 * distance_m / EE_STEP_M
    return success * minimum(oracle_steps / maximum(steps, 1.0), 1.0)


def weighted_by_path(success: Rows, shortest_m: Rows, path_m: Rows) -> Rows:
    """Returns Success * shortest / max(path, shortest), (N,): SPL of point navigation."""
    longest_m = maximum(maximum(path_m, shortest_m), 1e-6)
    return success * shortest_m / longest_m
