"""Place: bring the held object to its goal, release it, bring the hand to rest (S H.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from hab_tasks.arrays import Bools, Floats
from hab_tasks.constants import REST_RADIUS_M, SKILL_HORIZON_STEPS
from hab_tasks.engine.goals import Goals, Requirements
from hab_tasks.engine.measures import Measures
from hab_tasks.engine.rules import force_penalty
from hab_tasks.engine.sensors import OBJECT_GOAL, PROPRIOCEPTION
from hab_tasks.engine.skill_env import Skill, SkillEnv
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.episodes.generators.base import Generator, pose_scene, put_all, start_state
from hab_tasks.episodes.held import Held
from hab_tasks.episodes.placing import Placer, falls_to
from hab_tasks.episodes.robot_start import KeepOff
from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.schema import Episode, Rearrangement
from hab_tasks.errors import RejectedSampleError
from hab_tasks.receptacles import PLACE_RECEPTACLES
from hab_tasks.robots.control_modes import ARM_MODES
from hab_tasks.skills.pick import CLUTTER


class PlaceStarts(Generator):
    """A free goal among clutter on one of the seven receptacles."""

    def attempt(self, sandbox: PlacementSandbox, rng: np.random.Generator) -> Episode:
        """Returns one candidate."""
        spot = self.draw_spot(sandbox, rng, self.objects.receptacles or PLACE_RECEPTACLES)
        handles = self.draw(rng, 1 + int(rng.integers(CLUTTER[0], CLUTTER[1] + 1)))
        held = handles[0]
        sandbox.show(handles)
        sandbox.open_joints(spot.joints)
        placer = Placer(sandbox, rng, self.settling)
        if not placer.put(held, [spot]):
            raise RejectedSampleError("no room on the receptacle")
        put_all(placer, handles[1:], [spot])
        objects = placer.settle()
        if held not in objects:
            raise RejectedSampleError("the object does not stay at its goal")
        goal = objects.pop(held)
        goal_com_m, shape = sandbox.com_m(held), Held.of(sandbox, held)
        pose_scene(sandbox, objects, spot.joints)
        # Released at the start, the object must not fall onto its goal.
        keep_off = KeepOff(points_m=goal_com_m[None], level=True)
        robot = self.starts(sandbox, rng, keep_off).facing(goal_com_m)
        yaw = rng.uniform(-math.pi, math.pi)
        objects[held] = self.in_hand(shape, robot, yaw)
        pose_scene(sandbox, objects, spot.joints)
        if sandbox.touching(held):
            raise RejectedSampleError("the held object touches something")
        if falls_to(sandbox, robot, held, goal_com_m):
            raise RejectedSampleError("let go, the object gets to its goal by itself")
        pose_scene(sandbox, objects, spot.joints)
        target = Rearrangement(object=held, goal=spot.ref, world_from_goal=goal)
        return start_state(sandbox, robot, objects, (target,), held=held)


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


def success(s: Snapshot, m: Measures, g: Goals, c: PlaceConfig) -> Bools:
    """Object at rest at its goal and hand within the rest radius, (N,) bool."""
    return m.placed & (m.ee_to_rest_m < c.rest_radius_m)


def failures(s: Snapshot, m: Measures, g: Goals, c: PlaceConfig) -> dict[str, Bools]:
    """Failure conditions, each (N,) bool."""
    return {"force": m.force_total_n > c.force_limit_n}


def reward_terms(
    s: Snapshot, m: Measures, g: Goals, c: PlaceConfig, ends: dict[str, Bools]
) -> dict[str, Floats]:
    """Reward terms, each (N,) float32, in the equation's order."""
    w = c.weights
    holding = m.holding_target * 1.0
    return {
        "success": w.success * ends["success"],
        "place": w.place * (m.placed & ~m.placed_before),
        "approach": w.distance * m.object_to_goal_decrease_m * holding,
        # H.2 pays the return to rest while holding, which would reward keeping the object
        # (docs/deviations.md).
        "retract": w.distance * m.ee_to_rest_decrease_m * (1 - holding),
        "force": force_penalty(m.force_n, w.force, w.force_cap),
        "force_exceeded": -w.force_exceeded * ends["force"],
        "wrong_object": -w.wrong * m.picked_other_now,
    }


def taken_back(m: Measures, c: PlaceConfig) -> Floats:
    """What another grasp in a task takes back, (N,).

    The reward for the hand's way since the release, and how far the object got from its goal.
    """
    way_m = m.ee_to_rest_gain_m - np.minimum(m.object_to_goal_gain_m, 0.0)
    return c.weights.distance * m.picked_now * np.maximum(way_m, 0.0)


def mask_gripper(gripper: Floats, m: Measures) -> Floats:
    """Once the object is released at its goal nothing is grasped (S H.2), (N,)."""
    return np.where(m.released | m.released_before, -abs(gripper) - 1.0, gripper)


def reward_bound(c: PlaceConfig) -> float:
    """Maximum reward of a step: success, placement and 0.25 m of object motion."""
    w = c.weights
    return w.success + w.place + 0.25 * w.distance


PLACE = Skill(
    name="place",
    starts=PlaceStarts,
    instruction="Put the {object} {goal}.",
    config=PlaceConfig(),
    requirements=Requirements(goals=True, holds=True, takes="objects"),
    horizon_steps=SKILL_HORIZON_STEPS,
    control_modes=(*ARM_MODES, "ee_base"),
    observation=(*PROPRIOCEPTION, OBJECT_GOAL),
    measures=(
        *("object_to_goal_m", "ee_to_rest_m", "holding_target", "holding_other"),
        *("picked_other_now", "placed", "force_n", "force_total_n"),
    ),
    success=success,
    failures=failures,
    reward_terms=reward_terms,
    mask_gripper=mask_gripper,
    taken_back=taken_back,
    bound=reward_bound,
)


class HabPlaceEnv(SkillEnv):
    """Place the held object and return to rest; the base is fixed.

    **Start**: the object held by the gripper; goal and clutter on one of seven receptacles (sofa,
    fridge, left counter, right counter, light table, dark table, sink); the robot faces the goal.
    Noise: 20 deg on the base heading, 0.1 m on the base position, 0.05 m on the end-effector
    (S H.2).

    {observation}

    **Action**: ``ee`` 3 + 1, ``joint_delta``, ``joint_target``, ``joint_state`` 7 + 1,
    ``ee_base`` 3 + 1 + 2 (`hab_tasks.robots.control`). Once the object is released at its goal,
    grasping is disabled.

    **Reward** (terms in ``info["reward_terms"]``): 20 success + 5 place + 20 approach (holding)
    + 20 retract (not holding) - min(0.001 C, 1) - 10 force exceeded - 5 wrong.

    **Success**: object released and at rest within 0.15 m of its goal, end-effector within 0.15 m
    of its resting position.

    **Failure**: accumulated force above 7,500 N.

    **Horizon**: {horizon}. **Versions**: v1, initial version.
    """

    skill = PLACE
