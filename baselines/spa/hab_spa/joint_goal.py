"""Joint goal sampler of Pick (S App. D).

Grasp points are the centres of the faces of the object's bounding box. Inverse kinematics
starts from up to 1,000 random arm poses a face; of the solutions free of collisions, the one
nearest to the resting pose in joint space is the goal.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from hab_spa.collision import ArmCollision
from hab_spa.ik import LOWER_RAD, UPPER_RAD, BatchArm, IkConfig
from hab_spa.results import Failure, GoalResult
from hab_spa.shapes import Array
from hab_tasks.constants import REST_POSITION_M
from hab_tasks.robots.fetch_spec import REST_QPOS_RAD

WRIST_ROLL = 6


@dataclass(frozen=True, kw_only=True)
class GoalConfig:
    """The sampler's numbers.

    Attributes:
        starts_per_point: Random arm poses a grasp point (S App. D).
        round_starts: Of these, how many are tried before the count of goals is looked at.
        enough: Sampling stops when this many goals have the largest clearance.
        margins_m: Wanted clearances; the next is used only when the one before admits no goal.
        goals: How many goals are handed to the motion planner at most.
        same_goal_rad: Two goals differ by at least this much in some joint.
        rest_radius_m: Alternatives to the resting pose bring the end-effector this near to it.
        rest_spread_rad: Standard deviation of the starts around the resting pose.
    """

    starts_per_point: int = 1000
    round_starts: int = 125
    enough: int = 60
    margins_m: tuple[float, ...] = (0.02, 0.01, 0.003)
    goals: int = 4
    same_goal_rad: float = 0.3
    rest_radius_m: float = 0.08
    rest_spread_rad: float = 0.4
    ik: IkConfig = field(default_factory=IkConfig)


@dataclass(frozen=True, kw_only=True)
class GraspConfig:
    """When a hand at a point counts as able to take an object.

    Attributes:
        reach_safety_m: The object is at least this much nearer than the grasp radius.
        runner_up_m: Any other object is at least this much farther from the end-effector.
    """

    reach_safety_m: float = 0.01
    runner_up_m: float = 0.005


def sample_reaching_goals(
    points_m: Array, collision: ArmCollision, arm: BatchArm, seed: int, config: GoalConfig
) -> GoalResult:
    """Samples arm poses that bring the end-effector to one of some points.

    Args:
        points_m: (P, 3) in the world.
        collision: Tells which arm poses are free; its margin is left at the goals' clearance.
        arm: Kinematics.
        seed: Seeds the random arm poses.
        config: The sampler's numbers.
    """
    began, checks_before = time.perf_counter(), collision.checks
    rng = np.random.default_rng(seed)
    arm_from_world = collision.arm_from_world
    targets_m = points_m @ arm_from_world[:3, :3].T + arm_from_world[:3, 3]
    free, samples, roomy = np.zeros((0, 7)), 0, 0
    while len(targets_m) and samples < config.starts_per_point * len(targets_m):
        batch_m = np.repeat(targets_m, config.round_starts, axis=0)
        starts = rng.uniform(LOWER_RAD, UPPER_RAD, (len(batch_m), 7))
        samples += len(starts)
        solutions, reached = arm.solve(starts, batch_m, config.ik)
        found = _free(_with_rest_roll(solutions[reached]), collision, config.margins_m[-1])
        free = np.concatenate((free, found))
        roomy += len(_free(found, collision, config.margins_m[0]))
        if roomy >= config.enough:
            break
    goals = _best(free, collision, config)
    return GoalResult(
        goals=goals,
        failure=None if len(goals) else Failure.TARGET_PLAN,
        seconds=time.perf_counter() - began,
        samples=samples,
        checks=collision.checks - checks_before,
    )


def sample_rest_goals(
    collision: ArmCollision, arm: BatchArm, seed: int, config: GoalConfig
) -> GoalResult:
    """Samples arm poses that count as resting: the resting pose itself, then others near it.

    With an object in the grasp the exact pose may collide; the episode only asks that the
    end-effector is near the resting position.
    """
    began, checks_before = time.perf_counter(), collision.checks
    rng = np.random.default_rng(seed)
    rest = np.array(REST_QPOS_RAD)
    goals = np.zeros((0, 7))
    for margin_m in config.margins_m:
        collision.set_margin(margin_m)
        if collision.is_free(rest):
            goals = rest[None]
            break
    samples = 0
    if not len(goals):
        samples = config.round_starts * 4
        offset_m = rng.normal(size=(samples, 3))
        offset_m *= config.rest_radius_m / np.linalg.norm(offset_m, axis=1, keepdims=True)
        rest_m = np.array(REST_POSITION_M) - collision.base_from_arm[:3, 3]
        targets_m = rest_m + offset_m * rng.uniform(size=(samples, 1))
        starts = rest + rng.normal(scale=config.rest_spread_rad, size=(samples, 7))
        starts = np.clip(starts, LOWER_RAD, UPPER_RAD)
        solutions, reached = arm.solve(starts, targets_m, config.ik)
        goals = _best(solutions[reached], collision, config)
    return GoalResult(
        goals=goals,
        failure=None if len(goals) else Failure.TARGET_PLAN,
        seconds=time.perf_counter() - began,
        samples=samples,
        checks=collision.checks - checks_before,
    )


def _with_rest_roll(solutions: Array) -> Array:
    """Doubles (B, 7) solutions by copies with the resting wrist roll.

    The roll does not move the end-effector point, so the copies are solutions nearer to rest.
    """
    copies = solutions.copy()
    copies[:, WRIST_ROLL] = REST_QPOS_RAD[WRIST_ROLL]
    return np.concatenate((copies, solutions))


def _by_rest_distance(poses: Array) -> Array:
    return poses[np.argsort(np.linalg.norm(poses - np.array(REST_QPOS_RAD), axis=1))]


def _free(poses: Array, collision: ArmCollision, margin_m: float) -> Array:
    collision.set_margin(margin_m)
    keep = np.array([collision.is_free(pose) for pose in poses], dtype=bool)
    return poses[keep]


def _best(poses: Array, collision: ArmCollision, config: GoalConfig) -> Array:
    """The goals (G, 7) nearest to rest among the poses with the largest margin that one has."""
    free = np.zeros((0, 7))
    for margin_m in config.margins_m:
        free = _free(poses, collision, margin_m)
        if len(free):
            break
    chosen: list[Array] = []
    for pose in _by_rest_distance(free):
        if all(np.abs(pose - other).max() >= config.same_goal_rad for other in chosen):
            chosen.append(pose)
        if len(chosen) == config.goals:
            break
    return np.array(chosen).reshape(-1, 7)
