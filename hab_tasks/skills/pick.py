"""Pick: reach the target, snap it to the hand, bring the hand to rest (S App. C, E, H.2)."""

from __future__ import annotations

from dataclasses import dataclass, field

from hab_tasks.arrays import Rows, where
from hab_tasks.constants import REST_RADIUS_M, SKILL_HORIZON_STEPS
from hab_tasks.goals import Goals
from hab_tasks.measures import Measures
from hab_tasks.rewards import force_penalty, weighted_by_completion_time
from hab_tasks.robots.control_modes import ARM_MODES
from hab_tasks.sensors import OBJECT_START, PROPRIOCEPTION
from hab_tasks.skills.base import Skill, SkillEnv
from hab_tasks.skills.needs import Needs
from hab_tasks.snapshot import Snapshot


@dataclass(frozen=True, kw_only=True)
class PickWeights:
    """Weights of the reward in the order of the equation (S H.2, PICK)."""

    success: float = 20.0
    pickup: float = 5.0
    distance: float = 20.0
    force: float = 0.001
    force_cap: float = 1.0
    force_exceeded: float = 10.0
    wrong: float = 5.0
    dropped: float = 5.0


@dataclass(frozen=True, kw_only=True)
class PickConfig:
    """Thresholds of Pick (S H.2, E.2)."""

    weights: PickWeights = field(default_factory=PickWeights)
    rest_radius_m: float = REST_RADIUS_M
    force_limit_n: float = 5000.0


def success(s: Snapshot, m: Measures, g: Goals, c: PickConfig) -> Rows:
    """Target in the hand and hand within the rest radius, (N,) bool."""
    return m.holding_target & (m.ee_to_rest_m < c.rest_radius_m)


def failures(s: Snapshot, m: Measures, g: Goals, c: PickConfig) -> dict[str, Rows]:
    """Why an episode ends without success, each (N,) bool."""
    return {
        "force": m.force_total_n > c.force_limit_n,
        "wrong_object": m.holding_other,
        "dropped_object": m.dropped_now,
    }


def reward_terms(
    s: Snapshot, m: Measures, g: Goals, c: PickConfig, ends: dict[str, Rows]
) -> dict[str, Rows]:
    """The summands of the reward, each (N,) float32, in the equation's order."""
    w = c.weights
    holding = m.holding_target * 1.0
    return {
        "success": w.success * ends["success"],
        "pickup": w.pickup * m.picked_now,
        # Appendix C: the approach pays while NOT holding; H.2 lost the "!" (docs/deviations.md).
        "approach": w.distance * m.ee_to_object_decrease_m * (1 - holding),
        "retract": w.distance * m.ee_to_rest_decrease_m * holding,
        "force": force_penalty(m.force_n, w.force, w.force_cap),
        "force_exceeded": -w.force_exceeded * ends["force"],
        "wrong_object": -w.wrong * ends["wrong_object"],
        "dropped_object": -w.dropped * ends["dropped_object"],
    }


def mask_gripper(gripper: Rows, m: Measures) -> Rows:
    """Once the target is held it is not released until the skill ends (S E.2), (N,)."""
    return where(m.holding_target, abs(gripper), gripper)


def scores(m: Measures, success: Rows) -> dict[str, Rows]:
    """Success weighted by completion time (S F.2), (N,)."""
    return {"sct": weighted_by_completion_time(success, m.ee_to_object_start_m, m.steps)}


PICK = Skill(
    name="pick",
    config=PickConfig(),
    needs=Needs(takes="objects"),
    horizon_steps=SKILL_HORIZON_STEPS,
    control_modes=ARM_MODES,
    observation=(*PROPRIOCEPTION, OBJECT_START),
    measures=(
        "ee_to_object_m",
        "ee_to_rest_m",
        "holding_target",
        "holding_other",
        "picked_now",
        "dropped_now",
        "force_n",
        "force_total_n",
    ),
    success=success,
    failures=failures,
    reward_terms=reward_terms,
    mask_gripper=mask_gripper,
    scores=scores,
    # One step can at most succeed, pick up and move the hand by a quarter of a metre.
    reward_bound=20.0 + 5.0 + 20.0 * 0.25,
)


class HabPickEnv(SkillEnv):
    """Pick the target object and bring the hand to rest, base standing still.

    **Start**: target and clutter settled on one of six receptacles (sofa, fridge, counter left,
    counter right, light and dark table); the robot faces the target; noise of 20 deg on the base's
    heading, 0.1 m on its position, 0.05 m on the end-effector (S H.2). A fridge used is open.

    **Observation** (``state_dict``: ``agent`` and ``extra``; ``state`` is their concatenation):

    ====================  ===========  =====  ======  ==============================================
    entry                 group        shape  unit    meaning
    ====================  ===========  =====  ======  ==============================================
    arm_qpos              agent        7      rad     arm joints, shoulder to wrist
    ee_position           agent        3      m       end-effector in the base frame
    ee_rotation           agent        6      1       x, then y axis of the hand in the base frame
    is_holding            agent        1      0 or 1  whether anything is in the hand
    rest_from_ee          agent        3      m       from the hand to its rest position, base frame
    object_start_from_ee  extra        3      m       from the hand to the target's start
    head, arm             sensor_data  128²   0..1    depth, 1 at 10 m; uint8 with ``rgb``
    ====================  ===========  =====  ======  ==============================================

    **Action**: ``ee`` 3 + 1, ``joint_delta``, ``joint_target``, ``joint_state`` 7 + 1
    (`hab_tasks.robots.control`). Release is masked while the target is held.

    **Reward** (terms in ``info["reward_terms"]``): 20 success + 5 pickup + 20 approach (not
    holding) + 20 retract (holding) - min(0.001 C, 1) - 10 force exceeded - 5 wrong - 5 dropped.

    **Success**: target held, end-effector within 0.15 m of its rest position.

    **Failure**: accumulated force above 5,000 N, another object grasped, target lost.

    **Horizon**: 200 steps. **Versions**: v1, first.
    """

    skill = PICK
