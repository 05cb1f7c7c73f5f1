"""Place: bring the held object to its goal, let go, bring the hand to rest (S H.2)."""

from __future__ import annotations

from dataclasses import dataclass, field

from hab_tasks.arrays import Rows, where
from hab_tasks.constants import REST_RADIUS_M, SKILL_HORIZON_STEPS
from hab_tasks.goals import Goals
from hab_tasks.measures import Measures
from hab_tasks.rewards import force_penalty
from hab_tasks.robots.control_modes import ARM_MODES
from hab_tasks.sensors import OBJECT_GOAL, PROPRIOCEPTION
from hab_tasks.skills.base import Skill, SkillEnv
from hab_tasks.skills.needs import Needs
from hab_tasks.snapshot import Snapshot


@dataclass(frozen=True, kw_only=True)
class PlaceWeights:
    """Weights of the reward in the order of the equation (S H.2, PLACE)."""

    success: float = 20.0
    place: float = 5.0
    distance: float = 20.0
    force: float = 0.001
    force_cap: float = 1.0
    force_exceeded: float = 10.0
    wrong: float = 5.0


@dataclass(frozen=True, kw_only=True)
class PlaceConfig:
    """Thresholds of Place (S H.2, G.1)."""

    weights: PlaceWeights = field(default_factory=PlaceWeights)
    rest_radius_m: float = REST_RADIUS_M
    force_limit_n: float = 7500.0


def success(s: Snapshot, m: Measures, g: Goals, c: PlaceConfig) -> Rows:
    """Object let go at its goal and hand within the rest radius, (N,) bool."""
    return m.placed & (m.ee_to_rest_m < c.rest_radius_m)


def failures(s: Snapshot, m: Measures, g: Goals, c: PlaceConfig) -> dict[str, Rows]:
    """Why an episode ends without success, each (N,) bool."""
    return {"force": m.force_total_n > c.force_limit_n}


def reward_terms(
    s: Snapshot, m: Measures, g: Goals, c: PlaceConfig, ends: dict[str, Rows]
) -> dict[str, Rows]:
    """The summands of the reward, each (N,) float32, in the equation's order."""
    w = c.weights
    holding = m.holding_target * 1.0
    return {
        "success": w.success * ends["success"],
        "place": w.place * (m.placed & ~m.placed_before),
        "approach": w.distance * m.object_to_goal_decrease_m * holding,
        # H.2 pays the way to rest while holding, which would reward keeping the object
        # (docs/deviations.md).
        "retract": w.distance * m.ee_to_rest_decrease_m * (1 - holding),
        "force": force_penalty(m.force_n, w.force, w.force_cap),
        "force_exceeded": -w.force_exceeded * ends["force"],
        "wrong_object": -w.wrong * m.picked_other_now,
    }


def mask_gripper(gripper: Rows, m: Measures) -> Rows:
    """Once the object is placed nothing is grasped until the skill ends (S H.2), (N,)."""
    return where(m.placed | m.placed_before, -abs(gripper) - 1.0, gripper)


PLACE = Skill(
    name="place",
    config=PlaceConfig(),
    needs=Needs(goals=True, holds=True, takes="objects"),
    horizon_steps=SKILL_HORIZON_STEPS,
    control_modes=ARM_MODES,
    observation=(*PROPRIOCEPTION, OBJECT_GOAL),
    measures=(
        "object_to_goal_m",
        "ee_to_rest_m",
        "holding_target",
        "holding_other",
        "picked_other_now",
        "placed",
        "force_n",
        "force_total_n",
    ),
    success=success,
    failures=failures,
    reward_terms=reward_terms,
    mask_gripper=mask_gripper,
    # One step can at most succeed, place the object and move it by a quarter of a metre.
    reward_bound=20.0 + 5.0 + 20.0 * 0.25,
)


class HabPlaceEnv(SkillEnv):
    """Place the held object at its goal and bring the hand to rest, base standing still.

    **Start**: the object in the grasp; goal and clutter on one of seven receptacles (sofa, fridge,
    counter left, counter right, light and dark table, sink); the robot faces the goal; noise of
    20 deg on the base's heading, 0.1 m on its position, 0.05 m on the end-effector (S H.2).

    **Observation** (``state_dict``: ``agent`` and ``extra``; ``state`` is their concatenation):

    ====================  ===========  =====  ======  ==============================================
    entry                 group        shape  unit    meaning
    ====================  ===========  =====  ======  ==============================================
    arm_qpos              agent        7      rad     arm joints, shoulder to wrist
    ee_position           agent        3      m       end-effector in the base frame
    ee_rotation           agent        6      1       x, then y axis of the hand in the base frame
    is_holding            agent        1      0 or 1  whether anything is in the hand
    rest_from_ee          agent        3      m       from the hand to its rest position, base frame
    object_goal_from_ee   extra        3      m       from the hand to the object's goal
    head, arm             sensor_data  128²   0..1    depth, 1 at 10 m; uint8 with ``rgb``
    ====================  ===========  =====  ======  ==============================================

    **Action**: ``ee`` 3 + 1, ``joint_delta``, ``joint_target``, ``joint_state`` 7 + 1
    (`hab_tasks.robots.control`). Once the object is placed, nothing is grasped any more.

    **Reward** (terms in ``info["reward_terms"]``): 20 success + 5 place + 20 approach (holding)
    + 20 retract (not holding) - min(0.001 C, 1) - 10 force exceeded - 5 wrong.

    **Success**: object within 0.15 m of its goal and let go, end-effector within 0.15 m of its
    rest position.

    **Failure**: accumulated force above 7,500 N.

    **Horizon**: 200 steps. **Versions**: v1, first.
    """

    skill = PLACE
