"""Motions of a robot in a plan: commands and failures.

A motion is a generator that yields one `Command` per control step and is resumed after the next
observation. It returns None when it ends by its own condition, else its failure.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from enum import Enum
from typing import TypeAlias

from hab_tasks.privileged import Array

GRASP, RELEASE = 1.0, -1.0


class Failure(Enum):
    """Failed stage of sense-plan-act (S App. I.1); learned skills only fail by `TIMEOUT`."""

    TARGET_PLAN = "target plan"
    MOTION_PLAN = "motion plan"
    EXECUTION = "execution"
    TIMEOUT = "timeout"


@dataclass(frozen=True, kw_only=True, eq=False)
class Command:
    """Command of one control step.

    Attributes:
        arm_rad: (J,) joint targets.
        gripper: `GRASP` or `RELEASE`.
        base: Forward and turning velocity, relative to their maximum.
        pose: (3,) base pose to set directly, in modes that support it; None for the current one.
    """

    arm_rad: Array
    gripper: float
    base: tuple[float, float] = (0.0, 0.0)
    pose: Array | None = None


Motion: TypeAlias = Generator[Command, None, Failure | None]
"""A running motion."""
