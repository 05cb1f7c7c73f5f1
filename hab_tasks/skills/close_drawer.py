"""Close drawer: push the drawer in (S H.2)."""

from __future__ import annotations

from dataclasses import dataclass, field

from hab_tasks.arrays import Bools, Floats
from hab_tasks.articulations import DRAWER
from hab_tasks.constants import REST_RADIUS_M, SKILL_HORIZON_STEPS
from hab_tasks.engine.goals import Goals, Requirements
from hab_tasks.engine.measures import Measures
from hab_tasks.engine.sensors import OBJECT_START, PROPRIOCEPTION
from hab_tasks.engine.skill_env import Skill, SkillEnv
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.robots.control_modes import ARM_MODES
from hab_tasks.skills.open_drawer import HANDLE_MEASURES, OpenDrawerStarts


class CloseDrawerStarts(OpenDrawerStarts):
    """The drawer open by 80 to 100 % of its travel."""

    open_share = (0.8, 1.0)
    end_share = 0.0
    region = DRAWER.closing_region
    version = 9


@dataclass(frozen=True, kw_only=True)
class CloseWeights:
    """Weights of the reward of closing in the order of the equation (S H.2)."""

    success: float = 10.0
    handle: float = 1.0
    joint: float = 1.0


@dataclass(frozen=True, kw_only=True)
class CloseConfig:
    """Thresholds of Close drawer and Close fridge (S H.2)."""

    weights: CloseWeights = field(default_factory=CloseWeights)
    rest_radius_m: float = REST_RADIUS_M


def success(s: Snapshot, m: Measures, g: Goals, c: CloseConfig) -> Bools:
    """Drawer within 5 cm of closed, (N,) bool."""
    return DRAWER.is_closed(m.joint) & (m.ee_to_rest_m < c.rest_radius_m)


def reward_terms(
    s: Snapshot, m: Measures, g: Goals, c: CloseConfig, ends: dict[str, Bools]
) -> dict[str, Floats]:
    """Reward terms, each (N,) float32, in the equation's order."""
    w = c.weights
    return {
        "success": w.success * ends["success"],
        "handle": w.handle * m.ee_to_handle_decrease_m,
        # The goal is the joint's lower limit, so the distance to it changes as the joint does.
        "joint": -w.joint * m.joint_increase,
    }


def reward_bound(c: CloseConfig) -> float:
    """Maximum reward of a step: success, 0.25 m of hand motion, 0.5 m or rad of the joint."""
    w = c.weights
    return w.success + 0.25 * w.handle + 0.5 * w.joint


CLOSE_DRAWER = Skill(
    name="close_drawer",
    starts=CloseDrawerStarts,
    instruction="Close the drawer.",
    config=CloseConfig(),
    requirements=Requirements(articulations=(DRAWER,), names_articulation=True, takes="handles"),
    horizon_steps=SKILL_HORIZON_STEPS,
    control_modes=ARM_MODES,
    observation=(*PROPRIOCEPTION, OBJECT_START),
    measures=(*HANDLE_MEASURES, "force_n", "force_total_n"),
    success=success,
    reward_terms=reward_terms,
    bound=reward_bound,
)


class HabCloseDrawerEnv(SkillEnv):
    """Close a kitchen drawer and return to rest; the base is fixed.

    **Start**: the drawer open by 0.8 to 1 of its travel, a random subset of the other drawers open;
    the robot in a spawn region of 0.15 m x 0.75 m in front of it, facing the handle. Noise: 20 deg
    on the base heading, 0.05 m on the end-effector (S H.2).

    {observation}

    **Action**: ``ee`` 3 + 1, ``joint_delta``, ``joint_target``, ``joint_state`` 7 + 1
    (`hab_tasks.robots.control`). Only handles can be grasped.

    **Reward** (terms in ``info["reward_terms"]``): 10 success + handle + joint.

    **Success**: drawer within 0.05 m of closed, end-effector within 0.15 m of its
    resting position.

    **Failure**: none; contact forces are not limited.

    **Horizon**: {horizon}. **Versions**: v1, initial version.
    """

    skill = CLOSE_DRAWER
