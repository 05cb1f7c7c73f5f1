"""Results of the planning functions, and the failure categories of S App. I.1."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from hab_tasks.privileged import Array


class Failure(Enum):
    """Failed stage of sense-plan-act (S App. I.1); learned skills only fail by `TIMEOUT`."""

    TARGET_PLAN = "target plan"
    MOTION_PLAN = "motion plan"
    EXECUTION = "execution"
    TIMEOUT = "timeout"


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


@dataclass(frozen=True, kw_only=True, eq=False)
class PathResult:
    """A path of the arm.

    Attributes:
        path: (K, 7) [rad], piecewise linear in joint space; None if none was found.
        failure: `Failure.MOTION_PLAN` if none was found.
        seconds: Computing time [s].
        checks: Number of collision checks.
    """

    path: Array | None
    failure: Failure | None
    seconds: float
    checks: int
