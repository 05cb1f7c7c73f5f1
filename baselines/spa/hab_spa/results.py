"""What the planning functions return. Failures are named as in S App. I.1."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from hab_tasks.privileged import Array


class Failure(Enum):
    """Which stage of sense-plan-act failed (S App. I.1)."""

    TARGET_PLAN = "target plan"
    MOTION_PLAN = "motion plan"
    EXECUTION = "execution"


@dataclass(frozen=True, kw_only=True, eq=False)
class GoalResult:
    """Goals for the arm, best first.

    Attributes:
        goals: (G, 7) [rad]; empty (0, 7) if there is none.
        failure: `Failure.TARGET_PLAN` if there is none.
        seconds: Time spent [s].
        samples: Random arm poses from which inverse kinematics started.
        checks: Arm poses tested for collisions.
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
        path: (K, 7) [rad], joined by straight lines in joint space; None if none was found.
        failure: `Failure.MOTION_PLAN` if none was found.
        seconds: Time spent [s].
        checks: Arm poses tested for collisions.
    """

    path: Array | None
    failure: Failure | None
    seconds: float
    checks: int
