"""Close fridge: push the door closed (S H.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from hab_tasks.arrays import Bools, Floats
from hab_tasks.articulations import FRIDGE
from hab_tasks.constants import REST_RADIUS_M, SKILL_HORIZON_STEPS
from hab_tasks.engine.goals import Goals
from hab_tasks.engine.measures import Measures
from hab_tasks.engine.requirements import Requirements
from hab_tasks.engine.sensors import OBJECT_START, PROPRIOCEPTION
from hab_tasks.engine.skill_env import Skill, SkillEnv
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.robots.control_modes import MOBILE_MODES
from hab_tasks.skills.open_fridge import OpenFridgeStarts, outside


class CloseFridgeStarts(OpenFridgeStarts):
    """The door open between pi/4 and 2 pi/3."""

    open_rad = (math.pi / 4, 2 * math.pi / 3)


@dataclass(frozen=True, kw_only=True)
class CloseFridgeWeights:
    """Weights of the reward in the order of the equation (S H.2)."""

    success: float = 10.0
    handle: float = 1.0
    joint: float = 1.0


@dataclass(frozen=True, kw_only=True)
class CloseFridgeConfig:
    """Thresholds of Close fridge (S H.2)."""

    weights: CloseFridgeWeights = field(default_factory=CloseFridgeWeights)
    rest_radius_m: float = REST_RADIUS_M


def closed(s: Snapshot, m: Measures, g: Goals, c: CloseFridgeConfig) -> Bools:
    """Door within 0.15 rad of closed and hand within the rest radius, (N,) bool."""
    return FRIDGE.is_closed(m.joint) & (m.ee_to_rest_m < c.rest_radius_m)


def success(s: Snapshot, m: Measures, g: Goals, c: CloseFridgeConfig) -> Bools:
    """Closed, and the handle was grasped: not pushed by driving against the door, (N,) bool."""
    return closed(s, m, g, c) & (m.grabbed_before | m.holding_handle)


def failures(s: Snapshot, m: Measures, g: Goals, c: CloseFridgeConfig) -> dict[str, Bools]:
    """Failure conditions, each (N,) bool."""
    return {"left_region": outside(FRIDGE.closing_region, g.articulation_frame[:, 0], s.base)}


def reward_terms(
    s: Snapshot, m: Measures, g: Goals, c: CloseFridgeConfig, ends: dict[str, Bools]
) -> dict[str, Floats]:
    """Reward terms, each (N,) float32, in the equation's order."""
    w = c.weights
    return {
        "success": w.success * ends["success"],
        "handle": w.handle * m.ee_to_handle_decrease_m,
        # The goal is the joint's lower limit, so the distance to it changes as the joint does.
        "joint": -w.joint * m.joint_increase,
    }


def reward_bound(c: CloseFridgeConfig) -> float:
    """Maximum reward of a step: success, 0.25 m of hand motion, 0.5 rad of door motion."""
    w = c.weights
    return w.success + 0.25 * w.handle + 0.5 * w.joint


CLOSE_FRIDGE = Skill(
    name="close_fridge",
    starts=CloseFridgeStarts,
    instruction="Close the fridge.",
    config=CloseFridgeConfig(),
    requirements=Requirements(articulations=(FRIDGE,), names_articulation=True, takes="handles"),
    horizon_steps=SKILL_HORIZON_STEPS,
    control_modes=MOBILE_MODES,
    observation=(*PROPRIOCEPTION, OBJECT_START),
    measures=(
        "ee_to_handle_m",
        "ee_to_rest_m",
        "joint",
        "joint_share",
        "holding_handle",
        "force_n",
        "force_total_n",
    ),
    success=success,
    failures=failures,
    reward_terms=reward_terms,
    # A task's goal is a closed door, whoever closed it.
    done_in_task=closed,
    bound=reward_bound,
)


class HabCloseFridgeEnv(SkillEnv):
    """Close the fridge's upper door with arm and base, return to rest.

    **Start**: the door open by pi/4 to 2 pi/3; the robot in a spawn region of 0.9 m x 1.2 m in
    front of the fridge, facing the handle. Noise: 20 deg on the base heading, 0.05 m on the
    end-effector (S H.2).

    **Observation** (``state_dict``: ``agent`` and ``extra``; ``state`` is their concatenation):

    ====================  ===========  =====  ======  ==============================================
    entry                 group        shape  unit    meaning
    ====================  ===========  =====  ======  ==============================================
    arm_qpos              agent        7      rad     arm joints, shoulder to wrist
    ee_position           agent        3      m       end-effector in the base frame
    ee_rotation           agent        6      1       x, then y axis of the end-effector, base frame
    is_holding            agent        1      0 or 1  whether the gripper holds anything
    rest_from_ee          agent        3      m       end-effector to resting position, base frame
    object_start_from_ee  extra        3      m       end-effector to the object behind the door
    head, arm             sensor_data  128²   0..1    depth, 1 at 10 m; uint8 with ``rgb``
    ====================  ===========  =====  ======  ==============================================

    **Action**: ``ee_base`` 3 + 1 + 2; ``joint_delta_base``, ``joint_target_base`` and
    ``joint_state_base`` 7 + 1 + 2; ``joint_target_pose`` and ``joint_state_pose`` 7 + 1 + 3
    (`hab_tasks.robots.control`). Only handles can be grasped.

    **Reward** (terms in ``info["reward_terms"]``): 10 success + handle + joint.

    **Success**: door within 0.15 rad of closed, end-effector within 0.15 m of its
    resting position, handle grasped in this episode.

    **Failure**: the base leaves its spawn region; contact forces are not limited.

    **Horizon**: 200 steps. **Versions**: v1, initial version.
    """

    skill = CLOSE_FRIDGE
