"""Pick: reach the target, snap it to the hand, bring the hand to rest (S App. C, E, H.2)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from hab_tasks.arrays import Bools, Floats
from hab_tasks.constants import REST_RADIUS_M, SKILL_HORIZON_STEPS
from hab_tasks.engine.goals import Goals, Requirements
from hab_tasks.engine.measures import Measures
from hab_tasks.engine.rules import force_penalty, weighted_by_completion_time
from hab_tasks.engine.sensors import OBJECT_START, PROPRIOCEPTION
from hab_tasks.engine.skill_env import Skill, SkillEnv
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.episodes.generators.base import Generator, pose_scene, put_all, start_state
from hab_tasks.episodes.placing import Placer
from hab_tasks.episodes.robot_start import KeepOff, RobotStarts
from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.schema import Episode, Rearrangement, RobotStart
from hab_tasks.episodes.spots import Spot
from hab_tasks.errors import RejectedSampleError
from hab_tasks.geometry import Array
from hab_tasks.receptacles import PICK_RECEPTACLES
from hab_tasks.robots.control_modes import ARM_MODES

FINGERS_BELOW_TOP_M = 0.03
"""Fingers that come from above reach so far down."""

CLUTTER = (2, 5)
"""Minimum and maximum number of clutter objects."""


class PickStarts(Generator):
    """A target and clutter on one of the receptacles.

    Attributes:
        receptacles: Names of the receptacles.
        clutter: Minimum and maximum number of clutter objects.
    """

    receptacles: ClassVar[tuple[str, ...]] = PICK_RECEPTACLES
    clutter: ClassVar[tuple[int, int]] = CLUTTER

    def attempt(self, sandbox: PlacementSandbox, rng: np.random.Generator) -> Episode:
        """Returns one candidate."""
        spot = self.draw_spot(sandbox, rng, self.objects.receptacles or self.receptacles)
        least, most = self.clutter
        handles = self.draw(rng, 1 + int(rng.integers(least, most + 1)))
        sandbox.show(handles)
        sandbox.open_joints(spot.joints)
        placer = Placer(sandbox, rng, self.settling)
        if not put_all(placer, handles, [spot]):
            raise RejectedSampleError("no room on the receptacle")
        objects = placer.settle()
        if not objects:
            raise RejectedSampleError("nothing rests on the receptacle")
        target = list(objects)[int(rng.integers(len(objects)))]
        pose_scene(sandbox, objects, spot.joints)
        # Other objects count as well: grasping one first ends the episode.
        keep_off = KeepOff(points_m=sandbox.graspable_m())
        starts = self.starts(sandbox, rng, keep_off)
        robot = self.robot_start(starts, sandbox, spot, self.grasped_m(sandbox, target))
        return start_state(sandbox, robot, objects, (Rearrangement(object=target, start=spot.ref),))

    def grasped_m(self, sandbox: PlacementSandbox, target: str) -> Array:
        """Returns the point (3,) that the hand has to reach: of a tall object, near its top."""
        point_m = sandbox.com_m(target).copy()
        if self.objects.robot.fingers is not None:
            point_m[2] = max(point_m[2], sandbox.top_m(target) - FINGERS_BELOW_TOP_M)
        return point_m

    def robot_start(
        self, starts: RobotStarts, sandbox: PlacementSandbox, spot: Spot, target_m: Array
    ) -> RobotStart:
        """Returns the start of the robot for a target (3,) on a receptacle."""
        return starts.facing(target_m)


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


def success(s: Snapshot, m: Measures, g: Goals, c: PickConfig) -> Bools:
    """Target in the hand and hand within the rest radius, (N,) bool."""
    return m.holding_target & (m.ee_to_rest_m < c.rest_radius_m)


def failures(s: Snapshot, m: Measures, g: Goals, c: PickConfig) -> dict[str, Bools]:
    """Failure conditions, each (N,) bool."""
    return {
        "force": m.force_total_n > c.force_limit_n,
        "wrong_object": m.holding_other,
        "dropped_object": m.dropped_now,
    }


def reward_terms(
    s: Snapshot, m: Measures, g: Goals, c: PickConfig, ends: dict[str, Bools]
) -> dict[str, Floats]:
    """Reward terms, each (N,) float32, in the equation's order."""
    w = c.weights
    holding = m.holding_target * 1.0
    return {
        "success": w.success * ends["success"],
        "pickup": w.pickup * m.picked_now,
        # Appendix C: approach is paid while NOT holding; H.2 omits the "!" (docs/deviations.md).
        "approach": w.distance * m.ee_to_object_decrease_m * (1 - holding),
        "retract": w.distance * m.ee_to_rest_decrease_m * holding,
        "force": force_penalty(m.force_n, w.force, w.force_cap),
        "force_exceeded": -w.force_exceeded * ends["force"],
        "wrong_object": -w.wrong * ends["wrong_object"],
        "dropped_object": -w.dropped * ends["dropped_object"],
    }


def taken_back(m: Measures, c: PickConfig) -> Floats:
    """What a drop in a task takes back: the reward for this grasp and for the way since, (N,)."""
    w = c.weights
    return m.dropped_now * (w.pickup + w.distance * m.ee_to_rest_gain_m)


def mask_gripper(gripper: Floats, m: Measures) -> Floats:
    """Once the target is held it is not released until the skill ends (S E.2), (N,)."""
    return np.where(m.holding_target, abs(gripper), gripper)


def scores(m: Measures, success: Bools, ee_step_m: float) -> dict[str, Floats]:
    """Success weighted by completion time (S F.2), (N,)."""
    distance_m = m.ee_to_object_start_m
    return {"sct": weighted_by_completion_time(success, distance_m, m.steps, ee_step_m)}


def reward_bound(c: PickConfig) -> float:
    """Maximum reward of a step: success, pickup and 0.25 m of hand motion."""
    w = c.weights
    return w.success + w.pickup + 0.25 * w.distance


PICK = Skill(
    name="pick",
    starts=PickStarts,
    instruction="Pick up the {object} {start}.",
    config=PickConfig(),
    requirements=Requirements(takes="objects"),
    horizon_steps=SKILL_HORIZON_STEPS,
    control_modes=(*ARM_MODES, "ee_base"),
    observation=(*PROPRIOCEPTION, OBJECT_START),
    measures=(
        *("ee_to_object_m", "ee_to_rest_m", "holding_target", "holding_other"),
        *("picked_now", "dropped_now", "force_n", "force_total_n"),
    ),
    success=success,
    failures=failures,
    reward_terms=reward_terms,
    mask_gripper=mask_gripper,
    taken_back=taken_back,
    scores=scores,
    bound=reward_bound,
)


class HabPickEnv(SkillEnv):
    """Pick up the target and return to rest; the base is fixed.

    **Start**: target and clutter settled on one of six receptacles (sofa, fridge, left counter,
    right counter, light table, dark table); the robot faces the target. Noise: 20 deg on the base
    heading, 0.1 m on the base position, 0.05 m on the end-effector (S H.2). If the receptacle is
    the fridge, its door is open.

    {observation}

    **Action**: ``ee`` 3 + 1, ``joint_delta``, ``joint_target``, ``joint_state`` 7 + 1,
    ``ee_base`` 3 + 1 + 2 (`hab_tasks.robots.control`). The gripper cannot release the target.

    **Reward** (terms in ``info["reward_terms"]``): 20 success + 5 pickup + 20 approach (not
    holding) + 20 retract (holding) - min(0.001 C, 1) - 10 force exceeded - 5 wrong - 5 dropped.

    **Success**: target held, end-effector within 0.15 m of its resting position.

    **Failure**: accumulated force above 5,000 N, another object grasped, target dropped.

    **Horizon**: {horizon}. **Versions**: v1, initial version.
    """

    skill = PICK
