"""Navigate: drive to where another skill can start, turn the right way, and stop (S H.2)."""

from __future__ import annotations

from dataclasses import dataclass, field

from hab_tasks.arrays import Rows, where
from hab_tasks.constants import NAVIGATE_HORIZON_STEPS
from hab_tasks.goals import Goals
from hab_tasks.measures import Measures
from hab_tasks.rewards import weighted_by_path
from hab_tasks.sensors import IS_HOLDING, POINT
from hab_tasks.skills.base import Skill, SkillEnv
from hab_tasks.skills.needs import Needs
from hab_tasks.snapshot import Snapshot


@dataclass(frozen=True, kw_only=True)
class NavigateWeights:
    """Weights of the reward in the order of the equation (S H.2, Navigate)."""

    success: float = 10.0
    distance: float = 20.0
    heading: float = 1.0


@dataclass(frozen=True, kw_only=True)
class NavigateConfig:
    """Thresholds of Navigate (S H.2)."""

    weights: NavigateWeights = field(default_factory=NavigateWeights)
    goal_radius_m: float = 0.3
    goal_heading_rad: float = 0.5
    heading_counts_within_m: float = 0.9


def arrived(s: Snapshot, m: Measures, g: Goals, c: NavigateConfig) -> Rows:
    """Base at the goal and turned the right way, (N,) bool."""
    return (m.base_to_goal_m < c.goal_radius_m) & (m.heading_error_rad < c.goal_heading_rad)


def success(s: Snapshot, m: Measures, g: Goals, c: NavigateConfig) -> Rows:
    """Arrived, and the stop action called at the current step, (N,) bool."""
    return arrived(s, m, g, c) & m.stopped


def reward_terms(
    s: Snapshot, m: Measures, g: Goals, c: NavigateConfig, ends: dict[str, Rows]
) -> dict[str, Rows]:
    """The summands of the reward, each (N,) float32, in the equation's order."""
    w = c.weights
    near = m.base_to_goal_m < c.heading_counts_within_m
    return {
        "success": w.success * ends["success"],
        "distance": w.distance * m.base_to_goal_decrease_m,
        "heading": w.heading * m.heading_error_decrease_rad * near,
    }


def mask_gripper(gripper: Rows, m: Measures) -> Rows:
    """What is held stays held, and nothing else is grasped, (N,)."""
    holding = m.holding_target | m.holding_other | m.holding_handle
    return where(holding, 1.0, -1.0)


def scores(m: Measures, success: Rows) -> dict[str, Rows]:
    """Success weighted by path length, (N,)."""
    return {"spl": weighted_by_path(success, m.base_to_goal_start_m, m.path_m)}


NAVIGATE = Skill(
    name="navigate",
    config=NavigateConfig(),
    needs=Needs(leads=True, navigates=True),
    horizon_steps=NAVIGATE_HORIZON_STEPS,
    control_modes=("base_discrete", "base"),
    observation=(IS_HOLDING, POINT),
    measures=(
        "base_to_goal_m",
        "heading_error_rad",
        "stopped",
        "path_m",
        "force_n",
        "force_total_n",
    ),
    success=success,
    reward_terms=reward_terms,
    mask_gripper=mask_gripper,
    scores=scores,
    # A task has no stop action.
    done_in_task=arrived,
    # One step can at most succeed, and drive and turn at the largest speeds.
    reward_bound=10.0 + 20.0 * 0.25 + 0.5,
)


class HabNavigateEnv(SkillEnv):
    """Drive to a place from which another skill can start, and stop there, facing the right way.

    **Start**: anywhere on the free floor, turned anyhow; doors, drawers and objects as in a start
    of one of the other six skills, whose base pose is the goal (S H.2).

    **Observation** (``state_dict``: ``agent`` and ``extra``; ``state`` is their concatenation):

    ====================  ===========  =====  ======  ==============================================
    entry                 group        shape  unit    meaning
    ====================  ===========  =====  ======  ==============================================
    is_holding            agent        1      0 or 1  whether anything is in the hand
    point_in_base         extra        3      m       start or goal of the object, base frame
    head                  sensor_data  128²   0..1    depth, 1 at 10 m; uint8 with ``rgb``
    ====================  ===========  =====  ======  ==============================================

    The goal of the base itself is not observed.

    **Action**: ``base_discrete``, one of 20 cells of forward and turning velocity, or ``base``,
    both of them continuous (`hab_tasks.robots.control`). Standing still is the stop action.

    **Reward** (terms in ``info["reward_terms"]``): 10 success + 20 distance + heading (within
    0.9 m of the goal).

    **Success**: geodesic distance below 0.3 m, heading within 0.5 rad, stop action in this step.

    **Failure**: none; no limit on forces.

    **Horizon**: 500 steps. **Versions**: v1, first.
    """

    skill = NAVIGATE
    cameras = ("head",)
