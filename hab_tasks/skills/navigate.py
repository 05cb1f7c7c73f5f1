"""Navigate: drive to a start pose of another skill, face the goal heading, and stop (S H.2)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hab_tasks.arrays import Bools, Floats
from hab_tasks.constants import NAVIGATE_HORIZON_STEPS
from hab_tasks.engine.goals import Goals, Requirements
from hab_tasks.engine.measures import Measures
from hab_tasks.engine.rules import weighted_by_path
from hab_tasks.engine.sensors import IS_HOLDING, POINT
from hab_tasks.engine.skill_env import Skill, SkillEnv
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.episodes.generators.base import Generator, Objects, pose_scene
from hab_tasks.episodes.held import Held
from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.schema import Episode, NavigationGoal
from hab_tasks.errors import RejectedSampleError
from hab_tasks.instructions import navigation_template
from hab_tasks.registration import SKILLS, class_of
from hab_tasks.world.navigation import LayoutMaps
from hab_tasks.world.scenes.spec import SceneSpec

NAVIGATE_ID = "HabNavigate-v1"

LEAST_WAY_M = 1.0
"""Minimum straight-line distance between start and goal."""


class NavigateStarts(Generator):
    """Start states; the goal is a start pose of another skill."""

    version = 12

    def __init__(
        self, scenes: Sequence[str], load: Callable[[str], SceneSpec], objects: Objects
    ) -> None:
        """Samples layouts from `scenes`; `load` reads one."""
        super().__init__(scenes, load, objects)
        self._maps = LayoutMaps(load)
        self._others: dict[str, Generator] = {}

    def attempt(self, sandbox: PlacementSandbox, rng: np.random.Generator) -> Episode:
        """Returns one candidate."""
        others = [env_id for env_id in SKILLS if env_id != NAVIGATE_ID]
        skill = others[int(rng.integers(len(others)))]
        if skill not in self._others:
            self._others[skill] = class_of(skill).skill.starts(self.scenes, self.load, self.objects)
        episode = self._others[skill].attempt_for(self, sandbox, rng)
        goal = NavigationGoal(skill=skill, base=episode.robot.base)
        objects = dict(episode.objects)
        robot = self.starts(sandbox, rng).anywhere(np.array(goal.base[:2]), LEAST_WAY_M)
        # The map of the geodesic distance; narrow aisles free in the sandbox may be closed in it.
        ends_m = np.array((robot.base[:2], goal.base[:2]))
        if not self._maps.of(sandbox.spec.scene_id, episode.joints).is_free(ends_m).all():
            raise RejectedSampleError("no way from the start to the goal")
        if episode.held is not None:
            held, yaw = episode.held, rng.uniform(-np.pi, np.pi)
            objects[held] = self.in_hand(Held.of(sandbox, held), robot, yaw)
            pose_scene(sandbox, objects, episode.joints)
            if sandbox.touching(held):
                raise RejectedSampleError("the held object touches something")
        return replace(episode, robot=robot, objects=objects, navigation=goal)


@dataclass(frozen=True, kw_only=True)
class NavigateWeights:
    """Weights of the reward in the order of the equation (S H.2, Navigate)."""

    success: float = 10.0
    distance: float = 20.0
    heading: float = 1.0


@dataclass(frozen=True, kw_only=True)
class NavigateConfig:
    """Thresholds of Navigate (S H.2).

    Attributes:
        learned_stop: 1: success requires the stop action; 0: arriving is enough, as if an oracle
            stopped (S Fig. 27).
    """

    weights: NavigateWeights = field(default_factory=NavigateWeights)
    goal_radius_m: float = 0.3
    goal_heading_rad: float = 0.5
    heading_counts_within_m: float = 0.9
    learned_stop: float = 1.0


def arrived(s: Snapshot, m: Measures, g: Goals, c: NavigateConfig) -> Bools:
    """Base within the goal radius and heading tolerance, (N,) bool."""
    return (m.base_to_goal_m < c.goal_radius_m) & (m.heading_error_rad < c.goal_heading_rad)


def success(s: Snapshot, m: Measures, g: Goals, c: NavigateConfig) -> Bools:
    """Arrived, and the current action is the stop action if it is learned, (N,) bool."""
    there = arrived(s, m, g, c)
    return there & m.stopped if c.learned_stop else there


def reward_terms(
    s: Snapshot, m: Measures, g: Goals, c: NavigateConfig, ends: dict[str, Bools]
) -> dict[str, Floats]:
    """Reward terms, each (N,) float32, in the equation's order."""
    w = c.weights
    error, near = m.heading_error_rad, m.base_to_goal_m < c.heading_counts_within_m
    near_before = m.base_to_goal_m + m.base_to_goal_decrease_m < c.heading_counts_within_m
    before = np.where(near_before, error + m.heading_error_decrease_rad, np.pi)
    return {
        "success": w.success * ends["success"],
        "distance": w.distance * m.base_to_goal_decrease_m,
        # Far from the goal the error counts as pi: to turn away out there and to come back and turn
        # again pays nothing (docs/deviations.md).
        "heading": w.heading * (before - np.where(near, error, np.pi)),
    }


def mask_gripper(gripper: Floats, m: Measures) -> Floats:
    """Keeps the grasp: held objects stay held, and nothing else is grasped, (N,)."""
    holding = m.holding_target | m.holding_other | m.holding_handle
    return np.where(holding, 1.0, -1.0)


def scores(m: Measures, success: Bools, ee_step_m: float) -> dict[str, Floats]:
    """Success weighted by path length, (N,)."""
    return {"spl": weighted_by_path(success, m.base_to_goal_start_m, m.path_m)}


def reward_bound(c: NavigateConfig) -> float:
    """Maximum reward of a step: success, 0.25 m of the path and half a turn of heading."""
    w = c.weights
    return w.success + 0.25 * w.distance + np.pi * w.heading


NAVIGATE = Skill(
    name="navigate",
    starts=NavigateStarts,
    instruction=navigation_template,
    config=NavigateConfig(),
    requirements=Requirements(names_navigation_goal=True, navigates=True),
    horizon_steps=NAVIGATE_HORIZON_STEPS,
    control_modes=("base_discrete", "base"),
    observation=(IS_HOLDING, POINT),
    measures=(
        *("base_to_goal_m", "heading_error_rad", "stopped", "path_m"),
        *("force_n", "force_total_n"),
    ),
    success=success,
    reward_terms=reward_terms,
    mask_gripper=mask_gripper,
    scores=scores,
    # A task has no stop action.
    done_in_task=arrived,
    bound=reward_bound,
)


class HabNavigateEnv(SkillEnv):
    """Drive to the start pose of another skill and stop there.

    **Start**: the robot at a random free pose with random heading; doors, drawers and objects as
    in a start state of one of the other six skills, whose base pose is the goal (S H.2).

    {observation}

    The goal pose of the base is not observed.

    **Action**: ``base_discrete``, one of 20 cells of forward and turning velocity, or ``base``,
    continuous velocities (`hab_tasks.robots.control`). Zero velocity is the stop action.

    **Reward** (terms in ``info["reward_terms"]``): 10 success + 20 distance + heading (beyond
    0.9 m from the goal, its error counts as pi).

    **Success**: geodesic distance below 0.3 m, heading within 0.5 rad, stop action in this step
    (not with ``skill_config={"learned_stop": 0}``: S Fig. 27).

    **Failure**: none; contact forces are not limited.

    **Horizon**: {horizon}. **Versions**: v1, initial version.
    """

    skill = NAVIGATE
    cameras = ("head",)
