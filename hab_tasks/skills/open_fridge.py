"""Open fridge: pull the door open (S H.2)."""

from __future__ import annotations

from dataclasses import dataclass, field

from hab_tasks.arrays import Rows
from hab_tasks.constants import REST_RADIUS_M, SKILL_HORIZON_STEPS
from hab_tasks.fronts import FRIDGE
from hab_tasks.goals import Goals
from hab_tasks.measures import Measures
from hab_tasks.robots.control_modes import MOBILE_MODES
from hab_tasks.sensors import OBJECT_START, PROPRIOCEPTION
from hab_tasks.skills.base import Skill, SkillEnv
from hab_tasks.skills.needs import Needs
from hab_tasks.skills.regions import SPAWN_REGION, outside
from hab_tasks.snapshot import Snapshot


@dataclass(frozen=True, kw_only=True)
class OpenFridgeWeights:
    """Weights of the reward in the order of the equation (S H.2)."""

    success: float = 10.0
    grabbed: float = 5.0
    handle: float = 1.0
    joint: float = 1.0
    left_region: float = 10.0


@dataclass(frozen=True, kw_only=True)
class OpenFridgeConfig:
    """Thresholds of Open fridge (S H.2)."""

    weights: OpenFridgeWeights = field(default_factory=OpenFridgeWeights)
    rest_radius_m: float = REST_RADIUS_M


def success(s: Snapshot, m: Measures, g: Goals, c: OpenFridgeConfig) -> Rows:
    """Door open by more than 90 degrees, (N,) bool."""
    return FRIDGE.is_open(m.joint, m.joint_share) & (m.ee_to_rest_m < c.rest_radius_m)


def failures(s: Snapshot, m: Measures, g: Goals, c: OpenFridgeConfig) -> dict[str, Rows]:
    """Why an episode ends without success, each (N,) bool."""
    return {"left_region": outside(SPAWN_REGION, g.front[:, 0], s.base)}


def reward_terms(
    s: Snapshot, m: Measures, g: Goals, c: OpenFridgeConfig, ends: dict[str, Rows]
) -> dict[str, Rows]:
    """The summands of the reward, each (N,) float32, in the equation's order."""
    w = c.weights
    return {
        "success": w.success * ends["success"],
        "grabbed": w.grabbed * m.grabbed_now,
        "handle": w.handle * m.ee_to_handle_decrease_m,
        # The goal state is the joint's upper limit, so its distance changes as the joint does.
        "joint": w.joint * m.joint_increase,
        "left_region": -w.left_region * ends["left_region"],
    }


OPEN_FRIDGE = Skill(
    name="open_fridge",
    config=OpenFridgeConfig(),
    needs=Needs(fronts=(FRIDGE,), takes="handles"),
    horizon_steps=SKILL_HORIZON_STEPS,
    control_modes=MOBILE_MODES,
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
    failures=failures,
    reward_terms=reward_terms,
    # One step can at most succeed, grab the handle, move the hand by a quarter of a metre and
    # the door by half a radian.
    reward_bound=10.0 + 5.0 + 0.25 + 0.5,
)


class HabOpenFridgeEnv(SkillEnv):
    """Open the fridge's upper door with arm and base, and bring the hand to rest.

    **Start**: the door closed; the robot in a rectangle of 0.9 m x 1.2 m before the fridge, facing
    the handle; noise of 20 deg on the heading, 0.05 m on the end-effector (S H.2).

    **Observation** (``state_dict``: ``agent`` and ``extra``; ``state`` is their concatenation):

    ====================  ===========  =====  ======  ==============================================
    entry                 group        shape  unit    meaning
    ====================  ===========  =====  ======  ==============================================
    arm_qpos              agent        7      rad     arm joints, shoulder to wrist
    ee_position           agent        3      m       end-effector in the base frame
    ee_rotation           agent        6      1       x, then y axis of the hand in the base frame
    is_holding            agent        1      0 or 1  whether anything is in the hand
    rest_from_ee          agent        3      m       from the hand to its rest position, base frame
    object_start_from_ee  extra        3      m       from the hand to the object behind the door
    head, arm             sensor_data  128²   0..1    depth, 1 at 10 m; uint8 with ``rgb``
    ====================  ===========  =====  ======  ==============================================

    **Action**: ``ee_base`` 3 + 1 + 2; ``joint_delta_base``, ``joint_target_base`` and
    ``joint_state_base`` 7 + 1 + 2; ``joint_target_pose`` and ``joint_state_pose`` 7 + 1 + 3
    (`hab_tasks.robots.control`). The hand snaps to handles only.

    **Reward** (terms in ``info["reward_terms"]``): 10 success + 5 grabbed + handle + joint - 10
    left region.

    **Success**: door open by more than 90 degrees, end-effector within 0.15 m of its
    rest position.

    **Failure**: the base leaves the rectangle in which it started; no limit on forces.

    **Horizon**: 200 steps. **Versions**: v1, first.
    """

    skill = OPEN_FRIDGE
