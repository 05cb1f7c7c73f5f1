"""Open drawer: pull the drawer out (S H.2)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hab_tasks.arrays import Bools, Floats
from hab_tasks.articulations import DRAWER
from hab_tasks.constants import REST_RADIUS_M, SKILL_HORIZON_STEPS
from hab_tasks.engine.goals import Goals, Requirements
from hab_tasks.engine.measures import Measures
from hab_tasks.engine.sensors import OBJECT_START, PROPRIOCEPTION
from hab_tasks.engine.skill_env import Skill, SkillEnv
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.episodes.generators.base import Generator, pose_scene, start_state
from hab_tasks.episodes.generators.furniture import (
    LayoutArticulation,
    carried,
    find_articulation,
    handle_at,
    handles_m,
    level_frame,
    other_drawers,
    slides,
)
from hab_tasks.episodes.robot_start import KeepOff
from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.schema import POSE_DIGITS, Episode, Rearrangement
from hab_tasks.errors import RejectedSampleError
from hab_tasks.receptacles import DRAWER as DRAWER_RECEPTACLE
from hab_tasks.robots.control_modes import ARM_MODES

OTHERS_OPEN = 0.5
"""Probability that another drawer is open, by 0 to 100 % of its travel."""


class OpenDrawerStarts(Generator):
    """The drawer closed, the target in it, a random subset of the others open."""

    open_share: tuple[float, float] = (0.0, 0.0)
    end_share: float = DRAWER.open_share
    region = DRAWER.opening_region
    version = 11

    def attempt(self, sandbox: PlacementSandbox, rng: np.random.Generator) -> Episode:
        """Returns one candidate."""
        (spot,) = self.spots(sandbox, (DRAWER_RECEPTACLE,))[:1]
        articulation = find_articulation(sandbox, DRAWER.marker)
        handles = self.draw(rng, 1)
        objects = self.settled(sandbox, rng, handles, spot)
        if not slides(sandbox, objects, articulation):
            raise RejectedSampleError("the drawer cannot be moved with the object")
        travel_m = sandbox.joint_limits(articulation.ref.furniture, articulation.ref.joint)[1]
        end_m = handle_at(sandbox, articulation, self.end_share * travel_m)
        joints = self._other_joints(sandbox, rng, articulation)
        position = round(travel_m * float(rng.uniform(*self.open_share)), POSE_DIGITS)
        objects = carried(sandbox, objects, articulation, position)
        pose_scene(
            sandbox,
            objects,
            {articulation.ref.furniture: {articulation.ref.joint: position, **joints}},
        )
        if any(sandbox.touching(handle) for handle in objects):
            raise RejectedSampleError("the drawer cannot be closed over the object")
        link = sandbox.world_from(f"{articulation.ref.furniture}/{articulation.marker.link}")
        robot = self.starts(sandbox, rng, KeepOff(points_m=handles_m(sandbox))).in_rectangle(
            level_frame(link[:3, 3], link[:3, 0]),
            self.region,
            articulation.handle_m(sandbox),
            reach=True,
            end_m=end_m,
        )
        rearrangement = Rearrangement(object=handles[0], start=spot.ref)
        return start_state(sandbox, robot, objects, (rearrangement,), handle=articulation.ref)

    def _other_joints(
        self, sandbox: PlacementSandbox, rng: np.random.Generator, articulation: LayoutArticulation
    ) -> dict[str, float]:
        joints = {}
        for joint in other_drawers(sandbox, articulation):
            draw = rng.uniform(size=2)
            if draw[0] < OTHERS_OPEN:
                travel_m = sandbox.joint_limits(articulation.ref.furniture, joint)[1]
                joints[joint] = round(travel_m * float(draw[1]), POSE_DIGITS)
        return joints


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


def success(s: Snapshot, m: Measures, g: Goals, c: OpenDrawerConfig) -> Bools:
    """Drawer open by 90 % or more of its travel, (N,) bool."""
    return DRAWER.is_open(m.joint, m.joint_share) & (m.ee_to_rest_m < c.rest_radius_m)


def reward_terms(
    s: Snapshot, m: Measures, g: Goals, c: OpenDrawerConfig, ends: dict[str, Bools]
) -> dict[str, Floats]:
    """Reward terms, each (N,) float32, in the equation's order."""
    w = c.weights
    return {
        "success": w.success * ends["success"],
        "grabbed": w.grabbed * m.grabbed_now,
        "handle": w.handle * m.ee_to_handle_decrease_m,
        # The goal is the joint's upper limit, so the distance to it changes as the joint does.
        "joint": w.joint * m.joint_increase,
    }


def reward_bound(c: OpenDrawerConfig) -> float:
    """Maximum reward of a step: success, grab, 0.25 m of hand motion, 0.5 m or rad of the joint."""
    w = c.weights
    return w.success + w.grabbed + 0.25 * w.handle + 0.5 * w.joint


HANDLE_MEASURES = ("ee_to_handle_m", "ee_to_rest_m", "joint", "joint_share", "holding_handle")
"""Measures of all skills of doors and drawers."""

OPEN_DRAWER = Skill(
    name="open_drawer",
    starts=OpenDrawerStarts,
    instruction="Open the drawer.",
    config=OpenDrawerConfig(),
    requirements=Requirements(articulations=(DRAWER,), names_articulation=True, takes="handles"),
    horizon_steps=SKILL_HORIZON_STEPS,
    control_modes=ARM_MODES,
    observation=(*PROPRIOCEPTION, OBJECT_START),
    measures=(*HANDLE_MEASURES, "grabbed_now", "force_n", "force_total_n"),
    success=success,
    reward_terms=reward_terms,
    bound=reward_bound,
)


class HabOpenDrawerEnv(SkillEnv):
    """Open a kitchen drawer and return to rest; the base is fixed.

    **Start**: the drawer closed, a random subset of the other drawers open; the robot in a spawn
    region of 0.15 m x 0.75 m in front of it, facing the handle. Noise: 20 deg on the base heading,
    0.05 m on the end-effector (S H.2).

    {observation}

    **Action**: ``ee`` 3 + 1, ``joint_delta``, ``joint_target``, ``joint_state`` 7 + 1
    (`hab_tasks.robots.control`). Only handles can be grasped.

    **Reward** (terms in ``info["reward_terms"]``): 10 success + 5 grabbed + handle + joint.

    **Success**: drawer open by at least 0.9 of its travel, end-effector within 0.15 m of its
    resting position.

    **Failure**: none; contact forces are not limited.

    **Horizon**: {horizon}. **Versions**: v1, initial version.
    """

    skill = OPEN_DRAWER
