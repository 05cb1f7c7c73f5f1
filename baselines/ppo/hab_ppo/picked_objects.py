"""Place of objects as a pick leaves them in the hand, for training.

In the benchmark's start states of Place, the object is upright and its centre of mass at the hand.
In a task it hangs where it was grasped, and tilts with the hand: a can that is put down lying
rolls, also out of the range of its goal. Here objects are tilted and off the hand, half of them are
round, the goal is observed from the object, and only an object at rest near its goal is success.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from transforms3d import quaternions

from hab_ppo.fridge_starts import PlaceOftenStarts
from hab_tasks.arrays import BatchArray, where
from hab_tasks.constants import SKILL_HORIZON_STEPS
from hab_tasks.engine.goals import Goals
from hab_tasks.engine.measures import Measures
from hab_tasks.engine.sensors import OBJECT_GOAL, along_base_axes
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.episodes.generators.base import instances
from hab_tasks.episodes.schema import RobotStart, rounded
from hab_tasks.geometry import Array, Pose7, pose
from hab_tasks.registration import register_skill
from hab_tasks.skills.place import PLACE, HabPlaceEnv, PlaceConfig, success

ENV_ID = "PlacePicked-v1"

OFF_HAND_M = 0.12
"""Maximum distance of the object from the hand; grasps reach 0.15 m."""

TILT_RAD = math.pi / 2
"""Maximum tilt of the object."""

ROUND = ("002_master_chef_can", "005_tomato_soup_can", "007_tuna_fish_can")
ROUND_SHARE = 0.5
"""Objects that roll, and the share of episodes that take one of them for sure."""

NEAR_M = 0.1
"""Maximum distance of a placed object to its goal; 0.15 m in the benchmark."""

STILL_M = 0.001
"""An object at rest changes its distance to the goal by less than this in a step."""


class PickedStarts(PlaceOftenStarts):
    """Start states of Place with the object off the hand and tilted."""

    def draw(self, rng: np.random.Generator, count: int) -> list[str]:
        """See `Generator.draw`; the first object is the one in the hand."""
        names = [name.rpartition("_:")[0] for name in super().draw(rng, count)]
        rolling = [name for name in ROUND if name in self.objects.names]
        if rolling and rng.uniform() < ROUND_SHARE:
            names[0] = rolling[int(rng.integers(len(rolling)))]
        return instances(names)

    def in_hand(
        self, com_m: Array, up: Array, robot: RobotStart, rng: np.random.Generator
    ) -> Pose7:
        """Returns a pose of an object that hangs from the hand; see `Generator.in_hand`."""
        x, y, z, *upright = super().in_hand(com_m, up, robot, rng)
        held_m = np.array((x, y, z)) + quaternions.rotate_vector(com_m, upright)
        away = rng.normal(size=3)
        away[2] = -abs(away[2])  # above the hand is the wrist
        held_m += rng.uniform(0.0, OFF_HAND_M) * away / np.linalg.norm(away)
        side_rad = rng.uniform(-math.pi, math.pi)
        axis = (math.cos(side_rad), math.sin(side_rad), 0.0)
        tilt = quaternions.axangle2quat(axis, rng.uniform(0.0, TILT_RAD))
        q = quaternions.qmult(tilt, upright)
        return rounded(pose(held_m - quaternions.rotate_vector(com_m, q), q))


def goal_from_object(s: Snapshot, m: Measures, g: Goals) -> BatchArray:
    """Vector to the goal in base axes, (N, 3): from the held object, else from the hand."""
    goal_m, held = g.goals_m[:, 0], m.holding_target[:, None]
    off_hand_m = where(held, s.objects_m[:, 0] - s.ee_m, 0.0 * goal_m)
    return along_base_axes(s, goal_m - off_hand_m)


def rests_at_goal(s: Snapshot, m: Measures, g: Goals, c: PlaceConfig) -> BatchArray:
    """Success of Place with the object at rest and nearer to its goal, (N,) bool."""
    still = abs(m.object_to_goal_decrease_m) < STILL_M
    return success(s, m, g, c) & (m.object_to_goal_m < NEAR_M) & still


class PlacePickedEnv(HabPlaceEnv):
    """`HabPlaceEnv` with the object as a pick leaves it, often into the fridge."""

    skill = replace(
        PLACE,
        starts=PickedStarts,
        success=rests_at_goal,
        observation=tuple(
            replace(entry, read=goal_from_object, in_ee=None) if entry is OBJECT_GOAL else entry
            for entry in PLACE.observation
        ),
    )


register_skill(ENV_ID, f"{__name__}:PlacePickedEnv", SKILL_HORIZON_STEPS)
