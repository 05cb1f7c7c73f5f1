"""Whether a skill begins in a state like those in which its training episodes begin."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from hab_navigator.belief import Reach
from hab_spa.shapes import Array

from hab_tasks.constants import REST_POSITION_M
from hab_tasks.episodes import Episode, EpisodeRequest, load_episodes
from hab_tasks.registration import SKILLS
from hab_tasks.robots.kinematics import ArmKinematics
from hab_tasks.robots.spec import RobotSpec

EPISODES = 500
"""Episodes of each skill that ship with hab-tasks; they come from the generator of training."""

PERCENTILES = (0.5, 99.5)
SLACK = 0.05
"""Share of a range by which it is widened at both ends."""

SHY_M = 0.1
"""A base is sent so far into a range of distances, as it does not stop exactly there."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StartRanges:
    """Ranges of `features` over the episodes of a skill, without the extremes.

    Attributes:
        low: (4,) lower ends.
        high: (4,) upper ends.
    """

    low: Array
    high: Array

    def reach(self, level: bool) -> Reach:
        """Returns where the point may be when the skill starts.

        Args:
            level: Whether the hand comes to it level, not from above.
        """
        (near_m, right_rad), (far_m, left_rad) = self.low[:2].tolist(), self.high[:2].tolist()
        return Reach(
            distance_m=(near_m + SHY_M, far_m - SHY_M),
            bearing_rad=(right_rad, left_rad),
            level=level,
        )

    def include(self, found: Array) -> bool:
        """Whether all features (4,) of a start are in their ranges."""
        slack = SLACK * (self.high - self.low)
        return bool(((found >= self.low - slack) & (found <= self.high + slack)).all())


def features(point_m: Array, ee_m: Array) -> Array:
    """Returns the features of a start.

    Args:
        point_m: (3,) the point that the skill observes, in the base frame.
        ee_m: (3,) end-effector in the base frame.

    Returns:
        Distance [m], bearing [rad] and height [m] of the point, and the distance of the
        end-effector from rest [m], (4,).
    """
    x, y, z = point_m
    from_rest_m = np.linalg.norm(ee_m - np.array(REST_POSITION_M))
    return np.array((np.hypot(x, y), np.arctan2(y, x), z, from_rest_m), dtype=np.float64)


@functools.cache
def start_ranges(env_id: str, robot: RobotSpec) -> StartRanges | None:
    """Returns the ranges of a skill's environment; None if no episodes of it ship."""
    if env_id not in SKILLS:
        return None
    request = EpisodeRequest(env_id=env_id, split="val")
    arm, episodes = ArmKinematics(robot), load_episodes(request, EPISODES).episodes
    found = np.stack([_features_of(episode, arm) for episode in episodes])
    low, high = np.percentile(found, PERCENTILES, axis=0)
    low[-1] = 0.0  # the hand cannot be too near to rest
    return StartRanges(low=low, high=high)


def _features_of(episode: Episode, arm: ArmKinematics) -> Array:
    """Returns the features of the start of an episode."""
    (target, *_), (x, y, yaw) = episode.targets, episode.robot.base
    point_m = np.array((target.world_from_goal or episode.objects[target.object])[:3])
    cosine, sine = np.cos(yaw), np.sin(yaw)
    level_m = (point_m[:2] - np.array((x, y))) @ np.array(((cosine, -sine), (sine, cosine)))
    ee_m = arm.position(np.array(episode.robot.arm_qpos_rad))
    return features(np.append(level_m, point_m[2]), ee_m)
