"""Base pose selection for a skill, with the arm at rest or, where that has no room, tucked."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from hab_plans.motion import Motion
from hab_plans.protocols import BasePose

from hab_spa.motion.moves import go
from hab_spa.motion.rest import TUCKED_QPOS_RAD
from hab_spa.motion.robot import Robot
from hab_spa.shapes import Array

Score = Callable[[Array, int], float]
"""(base pose (3,), effort) -> number of solutions found from there; 0 if the pose is useless."""

SAME_ARM_RAD = 0.1
"""Maximum joint error of an arm that is already in the required pose."""


@dataclass(frozen=True, kw_only=True)
class StandingConfig:
    """Parameters of base pose selection.

    Attributes:
        base_poses: Number of base poses scored, from the better half of the candidates.
        more_base_poses: Number scored from all candidates if none of those is feasible.
        effort: Effort of the final round of scoring.
        enough_score: A base pose with this score is accepted immediately.
        apart_m: Minimum distance from base poses tried before.
    """

    base_poses: int = 16
    more_base_poses: int = 60
    effort: int = 6
    enough_score: float = 12
    apart_m: float = 0.12


def choose(
    robot: Robot, poses: Array, score: Score, tried: Sequence[BasePose], config: StandingConfig
) -> BasePose | None:
    """Returns the best-scored base pose for a skill.

    Args:
        robot: The robot, its arm at rest.
        poses: Candidates (K, 3), best first.
        score: Scores them.
        tried: Base poses that have failed.
        config: Parameters.
    """
    for other in tried:
        poses = poses[np.linalg.norm(poses[:, :2] - other.base[:2], axis=1) >= config.apart_m]
    few = spread(np.array_split(poses, 2)[0], config.base_poses)
    more = spread(poses, config.more_base_poses)
    arms = (robot.scene.arm_qpos.copy(), np.array(TUCKED_QPOS_RAD))
    for (some, effort), arm_rad in product(((few, 1), (more, 1), (more, config.effort)), arms):
        best, highest = None, 0.0
        for pose, value in _scored(robot, score, some, arm_rad, effort):
            if value > highest:
                best, highest = pose, value
            if highest >= config.enough_score:
                break
        if best is not None:
            return BasePose(base=best, arm_rad=arm_rad)
    return None


def spread(poses: Array, count: int) -> Array:
    """Returns about `count` of the poses (K, 3), at regular intervals."""
    return poses[:: max(1, len(poses) // count)]


def _scored(
    robot: Robot, score: Score, poses: Array, arm_rad: Array, effort: int
) -> Iterator[tuple[Array, float]]:
    """Yields the base poses (3,) at which the arm is collision-free, with their scores."""
    for pose in poses:
        if robot.scene.collision(base=pose).is_free(arm_rad):
            yield pose, score(pose, effort)


def fold(robot: Robot, standing: BasePose) -> Motion:
    """Moves the arm to the pose for driving to a base pose."""
    gap_rad = np.abs(robot.scene.arm_qpos - standing.arm_rad).max()
    if gap_rad <= SAME_ARM_RAD:
        return None
    robot.doing = "fold"
    return (yield from go(robot, robot.scene.collision(), standing.arm_rad[None]))
