"""Close fridge: push the door closed (S H.2)."""

from __future__ import annotations

import math

from hab_tasks.arrays import Bools
from hab_tasks.articulations import FRIDGE
from hab_tasks.constants import SKILL_HORIZON_STEPS
from hab_tasks.engine.goals import Goals, Requirements
from hab_tasks.engine.measures import Measures
from hab_tasks.engine.sensors import OBJECT_START, PROPRIOCEPTION
from hab_tasks.engine.skill_env import Skill, SkillEnv
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.robots.control_modes import MOBILE_MODES
from hab_tasks.skills.close_drawer import CloseConfig, reward_bound, reward_terms
from hab_tasks.skills.open_drawer import HANDLE_MEASURES
from hab_tasks.skills.open_fridge import OpenFridgeStarts, outside


class CloseFridgeStarts(OpenFridgeStarts):
    """The door open between pi/4 and 2 pi/3."""

    open_rad = (math.pi / 4, 2 * math.pi / 3)


def closed(s: Snapshot, m: Measures, g: Goals, c: CloseConfig) -> Bools:
    """Door within 0.15 rad of closed and hand within the rest radius, (N,) bool."""
    return FRIDGE.is_closed(m.joint) & (m.ee_to_rest_m < c.rest_radius_m)


def success(s: Snapshot, m: Measures, g: Goals, c: CloseConfig) -> Bools:
    """Closed, and the handle was grasped: not pushed by driving against the door, (N,) bool."""
    return closed(s, m, g, c) & (m.grabbed_before | m.holding_handle)


def failures(s: Snapshot, m: Measures, g: Goals, c: CloseConfig) -> dict[str, Bools]:
    """Failure conditions, each (N,) bool."""
    return {"left_region": outside(FRIDGE.closing_region, g.articulation_frame[:, 0], s.base)}


CLOSE_FRIDGE = Skill(
    name="close_fridge",
    starts=CloseFridgeStarts,
    instruction="Close the fridge.",
    config=CloseConfig(),
    requirements=Requirements(articulations=(FRIDGE,), names_articulation=True, takes="handles"),
    horizon_steps=SKILL_HORIZON_STEPS,
    control_modes=MOBILE_MODES,
    observation=(*PROPRIOCEPTION, OBJECT_START),
    measures=(*HANDLE_MEASURES, "force_n", "force_total_n"),
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

    {observation}

    **Action**: ``ee_base`` 3 + 1 + 2; ``joint_delta_base``, ``joint_target_base`` and
    ``joint_state_base`` 7 + 1 + 2; ``joint_target_pose`` and ``joint_state_pose`` 7 + 1 + 3
    (`hab_tasks.robots.control`). Only handles can be grasped.

    **Reward** (terms in ``info["reward_terms"]``): 10 success + handle + joint.

    **Success**: door within 0.15 rad of closed, end-effector within 0.15 m of its
    resting position, handle grasped in this episode.

    **Failure**: the base leaves its spawn region; contact forces are not limited.

    **Horizon**: {horizon}. **Versions**: v1, initial version.
    """

    skill = CLOSE_FRIDGE
