"""Open fridge: pull the door open (S H.2)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hab_tasks.arrays import Bools, Floats
from hab_tasks.articulations import FRIDGE, Rectangle
from hab_tasks.constants import SKILL_HORIZON_STEPS
from hab_tasks.engine.goals import Goals, Requirements
from hab_tasks.engine.measures import Measures
from hab_tasks.engine.sensors import OBJECT_START, PROPRIOCEPTION
from hab_tasks.engine.skill_env import Skill, SkillEnv
from hab_tasks.engine.snapshot import Snapshot, world_to_base
from hab_tasks.episodes.generators.base import Generator, pose_scene, start_state
from hab_tasks.episodes.generators.furniture import find_articulation, handles_m, level_frame
from hab_tasks.episodes.robot_start import KeepOff
from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.schema import Episode, Rearrangement
from hab_tasks.errors import RejectedSampleError
from hab_tasks.receptacles import FRIDGE as FRIDGE_RECEPTACLE
from hab_tasks.robots.control_modes import MOBILE_MODES
from hab_tasks.skills import open_drawer
from hab_tasks.skills.open_drawer import HANDLE_MEASURES, OpenDrawerConfig, OpenDrawerWeights

MOST_IN_FRIDGE = 3


class OpenFridgeStarts(Generator):
    """The door closed, the target behind it."""

    open_rad: tuple[float, float] = (0.0, 0.0)
    region = FRIDGE.opening_region

    def attempt(self, sandbox: PlacementSandbox, rng: np.random.Generator) -> Episode:
        """Returns one candidate."""
        (spot,) = self.spots(sandbox, (FRIDGE_RECEPTACLE,))[:1]
        articulation = find_articulation(sandbox, FRIDGE.marker)
        handles = self.draw(rng, int(rng.integers(1, MOST_IN_FRIDGE + 1)))
        objects = self.settled(sandbox, rng, handles, spot)
        target = list(objects)[int(rng.integers(len(objects)))]
        angle = round(float(rng.uniform(*self.open_rad)), 6)
        pose_scene(sandbox, objects, {articulation.ref.furniture: {articulation.ref.joint: angle}})
        if sandbox.touching(f"{articulation.ref.furniture}/{articulation.marker.link}"):
            raise RejectedSampleError("the door meets something")
        root = sandbox.world_from(
            f"{articulation.ref.furniture}/{sandbox.root_of(articulation.ref.furniture)}"
        )
        robot = self.starts(sandbox, rng, KeepOff(points_m=handles_m(sandbox))).in_rectangle(
            level_frame(root[:3, 3], root[:3, 0]),
            self.draw_region(rng),
            articulation.handle_m(sandbox),
            reach=False,
        )
        rearrangement = Rearrangement(object=target, start=spot.ref)
        return start_state(sandbox, robot, objects, (rearrangement,), handle=articulation.ref)

    def draw_region(self, rng: np.random.Generator) -> Rectangle:
        """Returns where the base starts, in the fridge's frame: always in `region`."""
        return self.region


def outside(region: Rectangle, frame: Floats, base: Floats) -> Bools:
    """Whether bases (N, 3) have left a rectangle in the furniture's frame (N, 3), (N,) bool.

    Both are x [m], y [m], yaw [rad].
    """
    local = world_to_base(frame, base[:, None])[:, 0]
    x, y = local[:, 0], local[:, 1]
    return (x < region.x_m[0]) | (x > region.x_m[1]) | (y < region.y_m[0]) | (y > region.y_m[1])


@dataclass(frozen=True, kw_only=True)
class OpenFridgeWeights(OpenDrawerWeights):
    """Weights of the reward in the order of the equation (S H.2)."""

    left_region: float = 10.0


@dataclass(frozen=True, kw_only=True)
class OpenFridgeConfig(OpenDrawerConfig):
    """Thresholds of Open fridge (S H.2)."""

    weights: OpenFridgeWeights = field(default_factory=OpenFridgeWeights)


def success(s: Snapshot, m: Measures, g: Goals, c: OpenFridgeConfig) -> Bools:
    """Door open by more than 90 degrees, (N,) bool."""
    return FRIDGE.is_open(m.joint, m.joint_share) & (m.ee_to_rest_m < c.rest_radius_m)


def failures(s: Snapshot, m: Measures, g: Goals, c: OpenFridgeConfig) -> dict[str, Bools]:
    """Failure conditions, each (N,) bool."""
    return {"left_region": outside(FRIDGE.opening_region, g.articulation_frame[:, 0], s.base)}


def reward_terms(
    s: Snapshot, m: Measures, g: Goals, c: OpenFridgeConfig, ends: dict[str, Bools]
) -> dict[str, Floats]:
    """Reward terms of Open drawer and the penalty, each (N,) float32, in the equation's order."""
    left_region = -c.weights.left_region * ends["left_region"]
    return {**open_drawer.reward_terms(s, m, g, c, ends), "left_region": left_region}


OPEN_FRIDGE = Skill(
    name="open_fridge",
    starts=OpenFridgeStarts,
    instruction="Open the fridge.",
    config=OpenFridgeConfig(),
    requirements=Requirements(articulations=(FRIDGE,), names_articulation=True, takes="handles"),
    horizon_steps=SKILL_HORIZON_STEPS,
    control_modes=MOBILE_MODES,
    observation=(*PROPRIOCEPTION, OBJECT_START),
    measures=(*HANDLE_MEASURES, "grabbed_now", "force_n", "force_total_n"),
    success=success,
    failures=failures,
    reward_terms=reward_terms,
    bound=open_drawer.reward_bound,
)


class HabOpenFridgeEnv(SkillEnv):
    """Open the fridge's upper door with arm and base, return to rest.

    **Start**: the door closed; the robot in a spawn region of 0.9 m x 1.2 m in front of the fridge,
    facing the handle. Noise: 20 deg on the base heading, 0.05 m on the end-effector (S H.2).

    {observation}

    **Action**: ``ee_base`` 3 + 1 + 2; ``joint_delta_base``, ``joint_target_base`` and
    ``joint_state_base`` 7 + 1 + 2; ``joint_target_pose`` and ``joint_state_pose`` 7 + 1 + 3
    (`hab_tasks.robots.control`). Only handles can be grasped.

    **Reward** (terms in ``info["reward_terms"]``): 10 success + 5 grabbed + handle + joint - 10
    left region.

    **Success**: door open by more than 90 degrees, end-effector within 0.15 m of its
    resting position.

    **Failure**: the base leaves its spawn region; contact forces are not limited.

    **Horizon**: {horizon}. **Versions**: v1, initial version.
    """

    skill = OPEN_FRIDGE
