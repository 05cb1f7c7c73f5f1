"""Joint goal samplers: to reach points, and to rest (S App. D).

Grasp points are the centres of the faces of the object's bounding box. Inverse kinematics
starts from up to 1,000 random arm poses a face; of the solutions free of collisions, the one
nearest to the resting pose in joint space is the goal. In tight places, points all around the
object are tried from arm poses near rest.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from hab_spa.planning.collision import ArmCollision
from hab_spa.planning.ik import LOWER_RAD, UPPER_RAD, BatchArm, IkConfig, Tool
from hab_spa.results import Failure, GoalResult
from hab_spa.shapes import Array, invert_pose
from hab_tasks.constants import REST_POSITION_M
from hab_tasks.robots.fetch_spec import REST_QPOS_RAD

REST_RAD = np.array(REST_QPOS_RAD)
WRIST_ROLL = 6

JUDGE_SEED = 0
"""Base poses are compared with the same random numbers."""


@dataclass(frozen=True, kw_only=True)
class GoalConfig:
    """The samplers' numbers.

    Attributes:
        starts_per_point: Random arm poses a grasp point (S App. D).
        round_starts: Of these, how many are tried before the count of goals is looked at.
        enough: Sampling stops when this many goals have the largest clearance.
        margins_m: Wanted clearances; the next is used only when the one before admits no goal.
        goals: How many goals are handed to the motion planner at most.
        same_goal_rad: Two goals differ by at least this much in some joint.
        rest_radius_m: Alternatives to the resting pose bring the end-effector this near to it.
        rest_spread_rad: Standard deviation of the starts around the resting pose.
        tight_starts: Arm poses to start from in tight places, over all points; ...
        tight_round: ... so many at a time, ...
        tight_enough: ... until this many goals have the largest clearance, ...
        tight_spread_rad: ... with this standard deviation around the resting pose.
        judge_starts: Arm poses to start from where it is only asked whether there are goals.
    """

    starts_per_point: int = 1000
    round_starts: int = 125
    enough: int = 60
    margins_m: tuple[float, ...] = (0.02, 0.01, 0.003)
    goals: int = 4
    same_goal_rad: float = 0.3
    rest_radius_m: float = 0.08
    rest_spread_rad: float = 0.4
    tight_starts: int = 6000
    tight_round: int = 500
    tight_enough: int = 20
    tight_spread_rad: float = 0.5
    judge_starts: int = 120
    ik: IkConfig = field(default_factory=IkConfig)


@dataclass(frozen=True, kw_only=True)
class GraspConfig:
    """When a hand at a point counts as able to take an object.

    Attributes:
        reach_safety_m: The object is at least this much nearer than the grasp radius.
        runner_up_m: Any other object is at least this much farther from the end-effector.
        around_m: In tight places it is taken at these distances from its centre of mass, ...
        sides: ... from so many sides.
    """

    reach_safety_m: float = 0.01
    runner_up_m: float = 0.005
    around_m: tuple[float, ...] = (0.08, 0.11, 0.138)
    sides: int = 80


@dataclass(frozen=True, kw_only=True, eq=False)
class Search:
    """A search for arm poses by inverse kinematics, in rounds.

    Attributes:
        draw: Returns arm poses to start from (B, 7), and their targets (B, 3) in the world.
        rounds: At most so many.
        enough: No more when so many poses have the largest margin, ...
        plenty: ... or this many times as many the least one.
        margins_m: Wanted clearances, the largest first.
        tool: What comes to the targets; None for the end-effector, whose resting roll is tried.
    """

    draw: Callable[[], tuple[Array, Array]]
    rounds: int
    enough: int
    margins_m: tuple[float, ...]
    plenty: int = 4
    tool: Tool | None = None

    def run(self, collision: ArmCollision, arm: BatchArm, ik: IkConfig) -> tuple[Array, int]:
        """Returns the poses (B, 7) free at the least margin, and how many starts that took."""
        free, samples, roomy = np.zeros((0, 7)), 0, 0
        for _ in range(self.rounds):
            starts, targets_m = self.draw()
            samples += len(starts)
            targets_m = in_arm(targets_m, collision)
            solutions, reached = arm.solve(starts, targets_m, ik, self.tool)
            found = solutions[reached]
            if self.tool is None:
                found = _with_rest_roll(found)
            found = free_poses(found, collision, self.margins_m[-1])
            free = np.concatenate((free, found))
            roomy += len(free_poses(found, collision, self.margins_m[0]))
            if roomy >= self.enough or len(free) >= self.plenty * self.enough:
                break
        return free, samples


def sample_reaching_goals(
    points_m: Array,
    collision: ArmCollision,
    arm: BatchArm,
    seed: int,
    config: GoalConfig,
    near: Array | None = None,
) -> GoalResult:
    """Samples arm poses that bring the end-effector to one of some points.

    With an arm pose `near` (7,) half of the search starts around it, and poses near it come first.

    Args:
        points_m: (P, 3) in the world.
        collision: Tells which arm poses are free; its margins are changed.
        arm: Kinematics.
        seed: Seeds the random arm poses.
        config: The sampler's numbers.
        near: The arm pose; None: any, and the resting one.
    """
    rng = np.random.default_rng(seed)
    batch_m = np.repeat(points_m, config.round_starts, axis=0)

    def draw() -> tuple[Array, Array]:
        starts = rng.uniform(LOWER_RAD, UPPER_RAD, (len(batch_m), 7))
        if near is not None:
            drawn = near + rng.normal(scale=config.tight_spread_rad, size=starts.shape)
            starts[::2] = np.clip(drawn, LOWER_RAD, UPPER_RAD)[::2]
        return starts, batch_m

    def cost(poses: Array) -> Array:
        return rest_distance(poses) if near is None else np.linalg.norm(poses - near, axis=1)

    search = Search(
        draw=draw,
        rounds=config.starts_per_point // config.round_starts if len(points_m) else 0,
        enough=config.enough,
        margins_m=config.margins_m,
    )
    return found_by(search, collision, arm, config, cost)


def sample_tight_goals(
    points_m: Array, collision: ArmCollision, arm: BatchArm, seed: int, config: GoalConfig
) -> GoalResult:
    """Samples as `sample_reaching_goals` does, but as `tight_search` says."""
    search = tight_search(points_m, seed, config)
    return found_by(search, collision, arm, config, rest_distance)


def tight_search(points_m: Array, seed: int, config: GoalConfig) -> Search:
    """Returns the search for arm poses with the hand at one of many points, from near rest.

    On a shelf or in a fridge the hand has to come straight in, which few random poses do.
    """
    rng = np.random.default_rng(seed)

    def draw() -> tuple[Array, Array]:
        starts = near_rest(rng, config.tight_round, config.tight_spread_rad)
        return starts, points_m[rng.integers(len(points_m), size=len(starts))]

    return Search(
        draw=draw,
        rounds=config.tight_starts // config.tight_round if len(points_m) else 0,
        enough=config.tight_enough,
        margins_m=config.margins_m,
    )


def sample_rest_goals(
    collision: ArmCollision, arm: BatchArm, seed: int, config: GoalConfig
) -> GoalResult:
    """Samples arm poses that count as resting: the resting pose itself, then others near it.

    With an object in the grasp the exact pose may collide; the episode only asks that the
    end-effector is near the resting position.
    """
    began, checks_before = time.perf_counter(), collision.checks
    for margin_m in config.margins_m:
        collision.set_margin(margin_m)
        if collision.is_free(REST_RAD):
            return GoalResult(
                goals=REST_RAD[None],
                failure=None,
                seconds=time.perf_counter() - began,
                samples=0,
                checks=collision.checks - checks_before,
            )
    rng = np.random.default_rng(seed)

    def draw() -> tuple[Array, Array]:
        starts = near_rest(rng, config.round_starts * 4, config.rest_spread_rad)
        offset_m = rng.normal(size=(len(starts), 3))
        offset_m *= config.rest_radius_m / np.linalg.norm(offset_m, axis=1, keepdims=True)
        rest_m = np.array(REST_POSITION_M) - collision.base_from_arm[:3, 3]
        world_from_arm = invert_pose(collision.arm_from_world)
        targets_m = rest_m + offset_m * rng.uniform(size=(len(starts), 1))
        return starts, targets_m @ world_from_arm[:3, :3].T + world_from_arm[:3, 3]

    search = Search(draw=draw, rounds=4, enough=1, margins_m=config.margins_m)
    return found_by(search, collision, arm, config, rest_distance)


def count_goals(search: Search, collision: ArmCollision, arm: BatchArm, config: GoalConfig) -> int:
    """Returns how many arm poses one round of a search finds that are free, if with less room."""
    once = replace(search, rounds=1, margins_m=search.margins_m[-1:])
    return len(once.run(collision, arm, config.ik)[0])


def found_by(
    search: Search,
    collision: ArmCollision,
    arm: BatchArm,
    config: GoalConfig,
    cost: Callable[[Array], Array],
) -> GoalResult:
    """Returns the goals of a search: those with the largest margin, the cheapest first.

    Where these are few, some with less room follow.

    Args:
        search: Finds arm poses.
        collision: Tells which are free; its margins are changed.
        arm: Kinematics.
        config: The samplers' numbers.
        cost: (B, 7) -> (B,).
    """
    began, checks_before = time.perf_counter(), collision.checks
    poses, samples = search.run(collision, arm, config.ik)
    poses = poses[np.argsort(cost(poses), kind="stable")]
    chosen = np.zeros((0, 7))
    for margin_m in search.margins_m:
        chosen = np.concatenate((chosen, free_poses(poses, collision, margin_m)))
        goals = apart(chosen, config)
        if len(goals) == config.goals:
            break
    return GoalResult(
        goals=goals,
        failure=None if len(goals) else Failure.TARGET_PLAN,
        seconds=time.perf_counter() - began,
        samples=samples,
        checks=collision.checks - checks_before,
    )


def sphere_m(centre_m: Array, radius_m: float, count: int) -> Array:
    """Returns points (count, 3) spread evenly over a sphere."""
    numbers = np.arange(count)
    height = 1.0 - (2.0 * numbers + 1.0) / count
    angle = numbers * np.pi * (3.0 - np.sqrt(5.0))  # the golden angle
    across = np.sqrt(1.0 - height**2)
    sides = np.stack((across * np.cos(angle), across * np.sin(angle), height), axis=1)
    return centre_m + radius_m * sides


def in_arm(points_m: Array, collision: ArmCollision) -> Array:
    """Returns world points (P, 3) in the frame of the arm's root."""
    arm_from_world = collision.arm_from_world
    return points_m @ arm_from_world[:3, :3].T + arm_from_world[:3, 3]


def near_rest(rng: np.random.Generator, count: int, spread_rad: float) -> Array:
    """Draws arm poses (count, 7) around the resting one."""
    drawn = REST_RAD + rng.normal(scale=spread_rad, size=(count, 7))
    return np.clip(drawn, LOWER_RAD, UPPER_RAD)


def rest_distance(poses: Array) -> Array:
    """Returns how far arm poses (B, 7) are from the resting one in joint space (B,) [rad]."""
    return np.linalg.norm(poses - REST_RAD, axis=1)


def free_poses(poses: Array, collision: ArmCollision, margin_m: float) -> Array:
    """Returns those of arm poses (B, 7) that keep a margin."""
    collision.set_margin(margin_m)
    keep = np.array([collision.is_free(pose) for pose in poses], dtype=bool)
    return poses[keep]


def apart(poses: Array, config: GoalConfig) -> Array:
    """Returns the first few arm poses (G, 7) that differ from one another."""
    chosen: list[Array] = []
    for pose in poses:
        if all(np.abs(pose - other).max() >= config.same_goal_rad for other in chosen):
            chosen.append(pose)
        if len(chosen) == config.goals:
            break
    return np.array(chosen).reshape(-1, 7)


def _with_rest_roll(solutions: Array) -> Array:
    """Doubles (B, 7) solutions by copies with the resting wrist roll.

    The roll does not move the end-effector point, so the copies are solutions nearer to rest.
    """
    copies = solutions.copy()
    copies[:, WRIST_ROLL] = REST_RAD[WRIST_ROLL]
    return np.concatenate((copies, solutions))
