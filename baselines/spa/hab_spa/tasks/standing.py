"""Where to stand for a skill, and with which arm: at rest, or folded where that has no room."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from hab_spa.motion.moves import go
from hab_spa.motion.rest import TUCKED_QPOS_RAD
from hab_spa.motion.robot import Motion, Robot
from hab_spa.shapes import Array
from hab_spa.tasks.interactions import Interaction, Ways
from hab_tasks.navigation import NavigationMap

SAME_ARM_RAD = 0.1
"""An arm this near to where it should be is not moved."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Standing:
    """A base pose (3,) and the arm pose (7,) [rad] in which the robot comes there."""

    base: Array
    arm_rad: Array


@dataclass(frozen=True, kw_only=True)
class StandingConfig:
    """How a place is chosen.

    Attributes:
        places: How many base poses of the better half are thought of ...
        more_places: ... and of all where none of those will do, ...
        effort: ... and how much harder ways are looked for in the end.
        enough_ways: A base pose with so many ways to do the skill is taken at once.
        apart_m: Another place to try from is at least this far from those tried before.
    """

    places: int = 16
    more_places: int = 60
    effort: int = 6
    enough_ways: float = 12
    apart_m: float = 0.12


def choose(
    robot: Robot,
    item: Interaction,
    map_: NavigationMap,
    tried: list[Standing],
    config: StandingConfig,
) -> Standing | None:
    """Returns the place with most ways to do something, and adds it to those tried.

    Args:
        robot: Who does it, its arm at rest.
        item: What is done.
        map_: The floor as it is now.
        tried: Places that did not work out.
        config: How many places are thought of.
    """
    poses = item.places(robot, map_)
    for other in tried:
        poses = poses[np.linalg.norm(poses[:, :2] - other.base[:2], axis=1) >= config.apart_m]
    few = spread(np.array_split(poses, 2)[0], config.places)
    more = spread(poses, config.more_places)
    arms = (robot.scene.arm_qpos.copy(), np.array(TUCKED_QPOS_RAD))
    ways_from = item.ways(robot, map_)
    for (some, effort), arm_rad in product(((few, 1), (more, 1), (more, config.effort)), arms):
        best, most = None, 0.0
        for pose, ways in _ways(robot, ways_from, some, arm_rad, effort):
            if ways > most:
                best, most = pose, ways
            if most >= config.enough_ways:
                break
        if best is not None:
            tried.append(Standing(base=best, arm_rad=arm_rad))
            return tried[-1]
    return None


def spread(poses: Array, count: int) -> Array:
    """Returns about so many of some poses (K, 3), evenly spread over them."""
    return poses[:: max(1, len(poses) // count)]


def _ways(
    robot: Robot, ways_from: Ways, poses: Array, arm_rad: Array, effort: int
) -> Iterator[tuple[Array, float]]:
    """Yields base poses (3,) where the arm is free, and how many ways there are from there."""
    for pose in poses:
        if robot.scene.collision(base=pose).is_free(arm_rad):
            yield pose, ways_from(pose, effort)


def fold(robot: Robot, standing: Standing) -> Motion:
    """Brings the arm to how it should be on the way to a place."""
    gap_rad = np.abs(robot.scene.arm_qpos - standing.arm_rad).max()
    if gap_rad <= SAME_ARM_RAD:
        return None
    robot.doing = "fold"
    return (yield from go(robot, robot.scene.collision(), standing.arm_rad[None]))
