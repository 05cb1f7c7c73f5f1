"""Open drawer: pull the drawer out (S H.2)."""

from __future__ import annotations

from dataclasses import dataclass, field

from hab_tasks.arrays import Rows
from hab_tasks.constants import REST_RADIUS_M, SKILL_HORIZON_STEPS
from hab_tasks.fronts import DRAWER
from hab_tasks.goals import Goals
from hab_tasks.measures import Measures
from hab_tasks.robots.control_modes import ARM_MODES
from hab_tasks.sensors import OBJECT_START, PROPRIOCEPTION
from hab_tasks.skills.base import Skill, SkillEnv
from hab_tasks.skills.needs import Needs
from hab_tasks.snapshot import Snapshot


@dataclass(frozen=True, kw_only=True)
class OpenDrawerWeights:
    """Weights of the reward in the order of the equation (S H.2)."""

    success: float = 10.0
    grabbed: float = 5.0
    handle: float = 1.0
    joint: float = 1.0


@dataclass(frozen=True, kw_only=True)
class OpenDrawerConfig:
    """Thresholds of Open drawer (S H.2)."""

    weights: OpenDrawerWeights = field(default_factory=OpenDrawerWeights)
    rest_radius_m: float = REST_RADIUS_M


def success(s: Snapshot, m: Measures, g: Goals, c: OpenDrawerConfig) -> Rows:
    """Drawer open by 90 % or more of its travel, (N,) bool."""
    return DRAWER.is_open(m.joint, m.joint_share) & (m.ee_to_rest_m < c.rest_radius_m)


def reward_terms(
    s: Snapshot, m: Measures, g: Goals, c: OpenDrawerConfig, ends: dict[str, Rows]
) -> dict[str, Rows]:
    """The summands of the reward, each (N,) float32, in the equation's order."""
    w = c.weights
    return {
        "success": w.success * ends["success"],
        "grabbed": w.grabbed * m.grabbed_now,
        "handle": w.handle * m.ee_to_handle_decrease_m,
        # The goal state is the joint's upper limit, so its distance changes as the joint does.
        "joint": w.joint * m.joint_increase,
    }


OPEN_DRAWER = Skill(
    name="open_drawer",
    config=OpenDrawerConfig(),
    needs=Needs(fronts=(DRAWER,), takes="handles"),
    horizon_steps=SKILL_HORIZON_STEPS,
    control_modes=ARM_MODES,
    observation=(*PROPRIOCEPTION, OBJECT_START),
    measures=(
        "ee_to_handle_m",
        "ee_to_rest_m",
        "joint",
        "joint_share",
        "holding_handle",
        "grabbed_now",
        "force_n",
        "force_total_n",
    ),
    success=success,
    reward_terms=reward_terms,
    # One step can at most succeed, grab the handle, move the hand by a quarter of a metre and
    # the drawer by half a metre.
    reward_bound=10.0 + 5.0 + 0.25 + 0.5,
)


class HabOpenDrawerEnv(SkillEnv):
    """Open a drawer of the kitchen counter and bring the hand to rest, base standing still.

    **Start**: the drawer closed, a random subset of the others open; the robot in a rectangle of
    0.15 m x 0.75 m before it, facing the handle; noise as in every skill (S H.2).

    **Observation** (``state_dict``: ``agent`` and ``extra``; ``state`` is their concatenation):

    ====================  ===========  =====  ======  ==============================================
    entry                 group        shape  unit    meaning
    ====================  ===========  =====  ======  ==============================================
    arm_qpos              agent        7      rad     arm joints, shoulder to wrist
    ee_position           agent        3      m       end-effector in the base frame
    ee_rotation           agent        6      1       x, then y axis of the hand in the base frame
    is_holding            agent        1      0 or 1  whether anything is in the hand
    rest_from_ee          agent        3      m       from the hand to its rest position, base frame
    object_start_from_ee  extra        3      m       from the hand to the object in the drawer
    head, arm             sensor_data  128²   0..1    depth, 1 at 10 m; uint8 with ``rgb``
    ====================  ===========  =====  ======  ==============================================

    **Action**: ``ee`` 3 + 1, ``joint_delta``, ``joint_target``, ``joint_state`` 7 + 1
    (`hab_tasks.robots.control`). The hand snaps to handles only.

    **Reward** (terms in ``info["reward_terms"]``): 10 success + 5 grabbed + handle + joint.

    **Success**: drawer open by 90 % or more of its travel, end-effector within 0.15 m of its
    rest position.

    **Failure**: none; no limit on forces.

    **Horizon**: 200 steps. **Versions**: v1, first.
    """

    skill = OPEN_DRAWER
