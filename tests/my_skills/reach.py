"""Reach: move the hand close to the target object without contact."""

from dataclasses import dataclass

from hab_tasks import (
    ARM_MODES,
    OBJECT_START,
    PROPRIOCEPTION,
    PickStarts,
    Requirements,
    Skill,
    SkillEnv,
)


@dataclass(frozen=True, kw_only=True)
class ReachConfig:
    """Weights and thresholds."""

    success: float = 5.0
    distance: float = 10.0
    near_m: float = 0.1
    force_limit_n: float = 1000.0


def success(s, m, g, c):
    """Hand near the object, (N,) bool."""
    return m.ee_to_object_m < c.near_m


def failures(s, m, g, c):
    """Pushed too hard, (N,) bool."""
    return {"force": m.force_total_n > c.force_limit_n}


def reward_terms(s, m, g, c, ends):
    """The summands of the reward, each (N,)."""
    return {
        "success": c.success * ends["success"],
        "approach": c.distance * m.ee_to_object_decrease_m,
    }


REACH = Skill(
    name="reach",
    starts=PickStarts,
    instruction="Reach for the {object} {start}.",
    config=ReachConfig(),
    requirements=Requirements(takes="objects"),
    horizon_steps=100,
    control_modes=ARM_MODES,
    observation=(*PROPRIOCEPTION, OBJECT_START),
    measures=("ee_to_object_m", "force_total_n"),
    success=success,
    failures=failures,
    reward_terms=reward_terms,
    bound=lambda c: c.success + 0.25 * c.distance,
)


class ReachEnv(SkillEnv):
    """Bring the hand within 0.1 m of the target object."""

    skill = REACH
