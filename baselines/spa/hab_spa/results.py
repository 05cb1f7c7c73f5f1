"""Result of the goal samplers."""

from __future__ import annotations

from dataclasses import dataclass

from hab_plans.motion import Failure

from hab_tasks.privileged import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class GoalResult:
    """Joint goals of the arm, best first.

    Attributes:
        goals: (G, 7) [rad]; empty (0, 7) if none was found.
        failure: `Failure.TARGET_PLAN` if none was found.
        seconds: Computing time [s].
        samples: Number of initial guesses for inverse kinematics.
        checks: Number of collision checks.
    """

    goals: Array
    failure: Failure | None
    seconds: float
    samples: int
    checks: int
