"""Rules of a skill or task for N rows: gripper mask, progress, success, failures, reward."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from operator import add, or_
from typing import TYPE_CHECKING, Any

import numpy as np
from torch import Tensor

from hab_tasks.arrays import Batch, Bools, Floats

if TYPE_CHECKING:
    from hab_tasks.engine.rows import Rows

Groups = dict[str, dict[str, Batch]]
"""Group -> name -> (N,)."""


@dataclass(frozen=True, kw_only=True)
class StepResult:
    """Result of the rules for one step.

    Attributes:
        success: (N,) whether the goal is reached, regardless of failures.
        failures: Name -> (N,) bool; any of them ends the episode.
        reward_terms: (ends) -> name -> (N,) float32; `ends` holds ``success`` and every failure.
        measures: (success) -> name -> (N,), reported in `info`.
        unpaid: Terms that cannot be paid in this step, zero (N,); reported with the others.
        extra: Further entries of `info`: name -> name -> (N,).
    """

    success: Bools
    failures: dict[str, Bools]
    reward_terms: Callable[[dict[str, Bools]], dict[str, Floats]]
    measures: Callable[[Bools], dict[str, Batch]]
    extra: Groups = field(default_factory=dict)
    unpaid: dict[str, Floats] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """Outcome of one step.

    Attributes:
        success: (N,) whether the goal is reached without a failure.
        fail: (N,) whether there is a failure.
        reward: (N,) sum of the reward terms.
        groups: Entries of `info` by group: ``failures``, ``measures``, ``reward_terms`` (those
            that can be paid), and the rules' own.
        unpaid: The other reward terms, zero (N,); the same dict in every step.
    """

    success: Bools
    fail: Bools
    reward: Floats
    groups: Groups
    unpaid: dict[str, Floats]


class Rules:
    """Rules of one skill or task for the episodes of `rows`."""

    def __init__(self, rows: Rows) -> None:
        """Applies to all episodes of `rows`."""
        self.rows = rows

    def step_result(self) -> StepResult:
        """Evaluates the current step; has no side effects."""
        raise NotImplementedError

    def masked_gripper(self, gripper: Floats) -> Floats:
        """Returns the gripper actions (N,) after masking."""
        raise NotImplementedError

    def begin_rows(self, rows: Sequence[int]) -> None:
        """Hook after the episodes in `rows` (R,) have started."""

    def before_action(self) -> None:
        """Hook before an action is executed."""

    def after_action(self) -> None:
        """Hook after an action, with the new snapshot and measures."""

    def get_state(self) -> dict[str, dict[str, Tensor]]:
        """Returns the state of the rules, if any: group -> name -> (N,)."""
        return {}

    def set_state(self, state: Mapping[str, Any], rows: Sequence[int]) -> None:
        """Restores `rows` (R,) from a state of R rows, at the current snapshot."""

    def evaluate(self) -> Evaluation:
        """Evaluates success, failures, reward and measures; has no side effects."""
        result = self.step_result()
        # The last argument is False in every row, for skills without failures.
        fail = reduce(or_, result.failures.values(), result.success & False)
        # One outcome an episode (docs/deviations.md), so a failed step earns no bonus either.
        success = result.success & ~fail
        terms = result.reward_terms({"success": success, **result.failures})
        groups = {
            "failures": result.failures,
            "measures": result.measures(success),
            "reward_terms": terms,
            **result.extra,
        }
        return Evaluation(
            success=success,
            fail=fail,
            reward=reduce(add, terms.values()),
            groups=groups,
            unpaid=result.unpaid,
        )


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
