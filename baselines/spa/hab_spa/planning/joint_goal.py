"""Joint goal samplers for reaching and resting (S App. D).

Grasp points are the face centres of the object's bounding box. Inverse kinematics starts from up
to 1,000 random arm poses per face; the goal is the collision-free solution nearest to the resting
pose in joint space. In confined spaces, points all around the object are tried from arm poses
near rest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from hab_spa.planning.collision import ArmCollision
from hab_spa.planning.ik import BatchArm, CompiledArm, IkConfig, Tool
from hab_spa.shapes import Array, invert_pose
from hab_tasks.arrays import Bools

AT_ONCE = 48
"""Arm poses that are checked first, of the cheapest; then twice as many, until there are goals."""

JUDGE_SEED = 0
"""Seed for scoring base poses, the same for all."""


@dataclass(frozen=True, kw_only=True)
class GoalConfig:
    """Parameters of the samplers. Starts are initial guesses for inverse kinematics.

    Attributes:
        starts_per_point: Random starts per grasp point (S App. D).
        round_starts: Starts per grasp point and round.
        enough: Sampling stops when this many goals have the largest clearance.
        margins_m: Clearances, most preferred first; the next one is used only if there are fewer
            than `goals` goals.
        goals: Maximum number of goals.
        same_goal_rad: Minimum difference between two goals, in the joint that differs most.
        rest_radius_m: Maximum distance of the end-effector from the resting position, for
            alternatives to the resting pose.
        rest_spread_rad: Standard deviation of their starts around the resting pose.
        tight_starts: Starts in confined spaces, over all grasp points.
        tight_round: Starts per round in confined spaces.
        tight_enough: As `enough`, in confined spaces.
        tight_spread_rad: Standard deviation of these starts around the resting pose.
        judge_starts: Starts for scoring a base pose.
        seeded_starts: With `CompiledArm`, starts from its table, over all points ...
        seeded_points: ... of which at most these are used ...
        seeded_round: ... and starts per round.
        ik: Parameters of inverse kinematics.
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
    seeded_starts: int = 4800
    seeded_points: int = 60
    seeded_round: int = 480
    ik: IkConfig = field(default_factory=IkConfig)


@dataclass(frozen=True, kw_only=True)
class GraspConfig:
    """Conditions for a point at which the hand can grasp an object.

    Attributes:
        reach_safety_m: Safety margin to the grasp radius.
        runner_up_m: Minimum additional distance of any other object from the end-effector.
        around_m: Distances from the object's centre of mass, in confined spaces.
        sides: Number of points at each of these distances.
    """

    reach_safety_m: float = 0.01
    runner_up_m: float = 0.005
    around_m: tuple[float, ...] = (0.08, 0.11, 0.138)
    sides: int = 80


@dataclass(frozen=True, kw_only=True, eq=False)
class Search:
    """A search for arm poses by inverse kinematics, in rounds.

    Attributes:
        draw: Samples starts (B, J) and their targets (B, 3) in the world.
        rounds: Maximum number of rounds.
        enough: The search stops when this many poses have the largest margin, ...
        plenty: ... or `plenty` times as many the smallest one.
        margins_m: Clearances, largest first.
        tool: Point that is moved to the targets; None for the end-effector, for which the resting
            wrist roll is tried as well.
    """

    draw: Callable[[], tuple[Array, Array]]
    rounds: int
    enough: int
    margins_m: tuple[float, ...]
    plenty: int = 4
    tool: Tool | None = None

    def run(self, collision: ArmCollision, arm: BatchArm, ik: IkConfig) -> Array:
        """Returns the poses (B, J) that are free at the smallest margin."""
        free, roomy = np.zeros((0, len(arm.rest_rad))), 0
        for _ in range(self.rounds):
            starts, targets_m = self.draw()
            targets_m = in_arm(targets_m, collision)
            solutions, reached = arm.solve(starts, targets_m, ik, self.tool)
            found = solutions[reached]
            if self.tool is None:
                found = _with_rest_roll(found, arm)
            found = free_poses(found, collision, self.margins_m[-1])
            # All are kept, as goals with small margins follow where roomy ones are too few.
            free = np.concatenate((free, found))
            # Roomy ones end the search, as a path into a corner is hard to find.
            roomy += len(free_poses(found, collision, self.margins_m[0]))
            if roomy >= self.enough or len(free) >= self.plenty * self.enough:
                break
        return free


def sample_reaching_goals(
    points_m: Array,
    collision: ArmCollision,
    arm: BatchArm,
    seed: int,
    config: GoalConfig,
    near: Array | None = None,
) -> Array:
    """Returns goals (G, J) with the end-effector at one of the points; none are found: (0, J).

    With an arm pose `near` (J,), half of the starts are around it, and goals near it come first.

    Args:
        points_m: (P, 3) in the world.
        collision: Collision model; its margins are changed.
        arm: Kinematics.
        seed: Seed of the random arm poses.
        config: Parameters.
        near: The arm pose; None for random starts, and goals near the resting pose first.
    """
    rng = np.random.default_rng(seed)
    batch_m = np.repeat(points_m, config.round_starts, axis=0)

    def draw() -> tuple[Array, Array]:
        starts = arm.random(rng, len(batch_m))
        if near is not None:
            drawn = near + rng.normal(scale=config.tight_spread_rad, size=starts.shape)
            # The others stay random: the pose near may be one from which nothing is found.
            starts[::2] = np.clip(drawn, *arm.limits_rad)[::2]
        return starts, batch_m

    search = Search(
        draw=draw,
        rounds=config.starts_per_point // config.round_starts if len(points_m) else 0,
        enough=config.enough,
        margins_m=config.margins_m,
    )
    first = arm.rest_rad if near is None else near
    return _goals_near(first, points_m, search, collision, arm, seed, config)


def sample_tight_goals(
    points_m: Array, collision: ArmCollision, arm: BatchArm, seed: int, config: GoalConfig
) -> Array:
    """Samples as `sample_reaching_goals`, by `tight_search`."""
    search = tight_search(points_m, arm, seed, config)
    return _goals_near(arm.rest_rad, points_m, search, collision, arm, seed, config)


def _goals_near(
    near: Array,
    points_m: Array,
    search: Search,
    collision: ArmCollision,
    arm: BatchArm,
    seed: int,
    config: GoalConfig,
) -> Array:
    """Returns goals, those near an arm pose (J,) first: of the arm's table or else of a search."""
    cost = _distance_to(near)
    if isinstance(arm, CompiledArm) and len(points_m):
        found = _seeded_goals(points_m, collision, arm, seed, config, cost)
        if len(found):
            return found
    return found_by(search, collision, arm, config, cost)


def tight_search(points_m: Array, arm: BatchArm, seed: int, config: GoalConfig) -> Search:
    """Returns the search for arm poses with the hand at one of many points, started near rest.

    On a shelf or in a fridge, the hand has to point straight in, as few random poses do.
    """
    rng = np.random.default_rng(seed)

    def draw() -> tuple[Array, Array]:
        starts = near_rest(arm, rng, config.tight_round, config.tight_spread_rad)
        return starts, points_m[rng.integers(len(points_m), size=len(starts))]

    return Search(
        draw=draw,
        rounds=config.tight_starts // config.tight_round if len(points_m) else 0,
        enough=config.tight_enough,
        margins_m=config.margins_m,
    )


def sample_rest_goals(
    collision: ArmCollision, arm: BatchArm, seed: int, config: GoalConfig
) -> Array:
    """Returns resting arm poses (G, J): the resting pose itself, or else alternatives near it.

    With a held object the exact pose may collide; the episode only requires the end-effector to
    be near the resting position.
    """
    for margin_m in config.margins_m:
        collision.set_margin(margin_m)
        if collision.is_free(arm.rest_rad):
            return arm.rest_rad[None]
    rng = np.random.default_rng(seed)

    def draw() -> tuple[Array, Array]:
        starts = near_rest(arm, rng, config.round_starts * 4, config.rest_spread_rad)
        offset_m = rng.normal(size=(len(starts), 3))
        # Uniform over radii and not over the volume, so that points are denser near the position.
        offset_m *= config.rest_radius_m / np.linalg.norm(offset_m, axis=1, keepdims=True)
        rest_m = np.array(collision.robot.rest_position_m) - collision.base_from_arm[:3, 3]
        world_from_arm = invert_pose(collision.arm_from_world)
        targets_m = rest_m + offset_m * rng.uniform(size=(len(starts), 1))
        return starts, targets_m @ world_from_arm[:3, :3].T + world_from_arm[:3, 3]

    search = Search(draw=draw, rounds=4, enough=1, margins_m=config.margins_m)
    return found_by(search, collision, arm, config, _distance_to(arm.rest_rad))


def count_goals(search: Search, collision: ArmCollision, arm: BatchArm, config: GoalConfig) -> int:
    """Returns the number of arm poses free at the smallest margin, from one round of a search."""
    once = replace(search, rounds=1, margins_m=search.margins_m[-1:])
    return len(once.run(collision, arm, config.ik))


def found_by(
    search: Search,
    collision: ArmCollision,
    arm: BatchArm,
    config: GoalConfig,
    cost: Callable[[Array], Array],
) -> Array:
    """Returns the goals (G, J) of a search: those with the largest margin, lowest cost first.

    If these are too few, goals with smaller margins follow.

    Args:
        search: The search.
        collision: Collision model; its margins are changed.
        arm: Kinematics.
        config: Parameters.
        cost: Costs of arm poses, (B, J) -> (B,).
    """
    poses = search.run(collision, arm, config.ik)
    return _roomiest(poses, collision, search.margins_m, config, cost)


def _seeded_goals(
    points_m: Array,
    collision: ArmCollision,
    arm: CompiledArm,
    seed: int,
    config: GoalConfig,
    cost: Callable[[Array], Array],
) -> Array:
    """Returns goals as `found_by`, from a table of arm poses near the points, cheapest first.

    The search ends with enough goals of the largest margin, so that few poses are checked.
    """
    rng = np.random.default_rng(seed)
    if len(points_m) > config.seeded_points:
        points_m = points_m[rng.choice(len(points_m), config.seeded_points, replace=False)]
    targets_m, count = in_arm(points_m, collision), config.seeded_starts // len(points_m)
    # The table is the same for every seed, but another attempt needs other starts.
    starts, numbers = arm.starts.near(targets_m, count, rng)
    # Inverse kinematics ends near its start, so that cheap starts give cheap goals.
    order = np.argsort(cost(starts), kind="stable")
    found = roomy = np.zeros((0, len(arm.rest_rad)))
    for first in range(0, len(order), config.seeded_round):
        chosen = order[first : first + config.seeded_round]
        poses, reached = arm.solve(starts[chosen], targets_m[numbers[chosen]], config.ik)
        poses = _with_rest_roll(poses[reached], arm)
        found = np.concatenate((found, poses))
        # The others differ in the roll only, and are farther from rest.
        poses = np.concatenate((roomy, poses[: len(poses) // 2]))
        cheap = np.argsort(cost(poses), kind="stable")
        collision.set_margin(config.margins_m[0])
        known = cheap < len(roomy)
        goals, roomy = _first_free(poses[:0], poses[cheap], known, collision, config)
        if len(goals) == config.goals:
            return goals
    return _roomiest(found, collision, config.margins_m, config, cost)


def _first_free(
    goals: Array, poses: Array, is_known: Bools, collision: ArmCollision, config: GoalConfig
) -> tuple[Array, Array]:
    """Returns goals (G, J) with free ones of more poses (B, J), in order, until they are enough.

    Also returns the poses known (B,) or found to be free.
    """
    free = is_known.copy()
    ends = AT_ONCE * 2 ** np.arange(16)
    for part in np.split(np.arange(len(poses)), ends[ends < len(poses)]):
        asked = part[~is_known[part]]
        free[asked] = collision.are_free(poses[asked])
        goals = apart(np.concatenate((goals, poses[part[free[part]]])), config)
        if len(goals) == config.goals:
            return goals, poses[free]
    return goals, poses[free]


def _roomiest(
    poses: Array,
    collision: ArmCollision,
    margins_m: tuple[float, ...],
    config: GoalConfig,
    cost: Callable[[Array], Array],
) -> Array:
    """Returns goals (G, J): those with the largest margin, lowest cost first."""
    # Stable, so that equal costs do not depend on the machine's sort.
    poses = poses[np.argsort(cost(poses), kind="stable")]
    goals, unknown = poses[:0], np.zeros(len(poses), dtype=bool)
    for margin_m in margins_m:
        # Poses of the larger margin come again with the smaller one; `apart` drops them.
        collision.set_margin(margin_m)
        goals, _ = _first_free(goals, poses, unknown, collision, config)
        if len(goals) == config.goals:
            break
    return goals


def _distance_to(pose: Array) -> Callable[[Array], Array]:
    """Returns a cost of arm poses (B, J): their distances to one (J,)."""
    return lambda poses: np.linalg.norm(poses - pose, axis=1)


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


def near_rest(arm: BatchArm, rng: np.random.Generator, count: int, spread_rad: float) -> Array:
    """Samples arm poses (count, J) around the resting pose."""
    drawn = arm.rest_rad + rng.normal(scale=spread_rad, size=(count, len(arm.rest_rad)))
    return np.clip(drawn, *arm.limits_rad)


def free_poses(poses: Array, collision: ArmCollision, margin_m: float) -> Array:
    """Returns the arm poses (B, J) that keep a margin."""
    collision.set_margin(margin_m)
    return poses[collision.are_free(poses)]


def apart(poses: Array, config: GoalConfig) -> Array:
    """Returns the first arm poses (G, J), at most `goals`, that differ from one another."""
    chosen: list[Array] = []
    for pose in poses:
        if all(np.abs(pose - other).max() >= config.same_goal_rad for other in chosen):
            chosen.append(pose)
        if len(chosen) == config.goals:
            break
    return np.array(chosen).reshape(-1, poses.shape[1])


def _with_rest_roll(solutions: Array, arm: BatchArm) -> Array:
    """Prepends copies of solutions (B, J) with the resting wrist roll.

    A roll does not move the end-effector point, so the copies are solutions too, nearer to rest.
    """
    copies = solutions.copy()
    if arm.ends_in_roll:
        copies[:, -1] = arm.rest_rad[-1]
    return np.concatenate((copies, solutions))
