"""Joint goal sampler of Place: moves the held object to its goal (S App. D).

The object is released a few millimetres above its goal and as upright as it was before the grasp,
so that it stays where it is released. If that is impossible, it may be tilted and released higher.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hab_spa.planning.collision import ArmCollision
from hab_spa.planning.ik import BatchArm, Tool
from hab_spa.planning.joint_goal import GoalConfig, Search, found_by, in_arm, near_rest
from hab_spa.shapes import Array


@dataclass(frozen=True, kw_only=True)
class PlacingConfig:
    """Parameters of placing goals.

    Attributes:
        starts: Starts of inverse kinematics, half of them random and half near rest.
        round_starts: Starts per round.
        enough: Sampling stops when this many goals have the largest clearance.
        heights_m: Candidate heights of the object above its goal.
        aside_m: Maximum horizontal offset from the goal, ...
        far_aside_m: ... and after a failed attempt.
        margins_m: Clearances, also between the object and its support.
        tilt_cost_m: Cost of a radian of tilt, in metres of height.
        rest_cost_m: Cost of a radian away from the resting pose, in metres of height.
    """

    starts: int = 4000
    round_starts: int = 400
    enough: int = 30
    heights_m: tuple[float, ...] = (0.004, 0.012, 0.025, 0.04, 0.06, 0.09)
    aside_m: float = 0.03
    far_aside_m: float = 0.08
    margins_m: tuple[float, ...] = (0.01, 0.003)
    tilt_cost_m: float = 0.1
    rest_cost_m: float = 0.01

    def looser(self) -> PlacingConfig:
        """Returns the parameters of an attempt after a failure."""
        return replace(self, aside_m=self.far_aside_m)


def sample_placing_goals(
    goal_m: Array,
    tool: Tool,
    collision: ArmCollision,
    arm: BatchArm,
    seed: int,
    config: GoalConfig,
    placing: PlacingConfig,
) -> Array:
    """Returns goals (G, J) with the held object at its goal, low and upright ones first.

    Args:
        goal_m: (3,) in the world.
        tool: Reference point and upright direction of the held object.
        collision: Collision model of the arm with the object; its margins are changed.
        arm: Kinematics.
        seed: Seed of the random arm poses.
        config: Parameters of all samplers.
        placing: Parameters of this sampler.
    """
    above_m = in_arm(goal_m[None], collision)[0, 2]

    def cost(poses: Array) -> Array:
        height_m = arm.points_m(poses, tool)[:, 2] - above_m
        tilt_rad = arm.tilts_rad(poses, tool)
        far_rad = np.linalg.norm(poses - arm.rest_rad, axis=1)
        return height_m + placing.tilt_cost_m * tilt_rad + placing.rest_cost_m * far_rad

    search = lowering(goal_m, tool, arm, seed, config, placing)
    return found_by(search, collision, arm, config, cost)


def lowering(
    goal_m: Array, tool: Tool, arm: BatchArm, seed: int, config: GoalConfig, placing: PlacingConfig
) -> Search:
    """Returns the search for arm poses with the held object at its goal (3,) or slightly above."""
    rng = np.random.default_rng(seed)

    def draw() -> tuple[Array, Array]:
        half = placing.round_starts // 2
        starts = np.concatenate(
            (arm.random(rng, half), near_rest(arm, rng, half, config.tight_spread_rad))
        )
        targets_m = np.tile(goal_m, (len(starts), 1))
        targets_m[:, 2] += rng.choice(placing.heights_m, len(starts))
        angle = rng.uniform(0.0, 2.0 * np.pi, len(starts))
        # The root makes points even over the disc instead of crowded in its middle.
        aside_m = placing.aside_m * np.sqrt(rng.uniform(size=len(starts)))
        targets_m[:, :2] += aside_m[:, None] * np.stack((np.cos(angle), np.sin(angle)), axis=1)
        return starts, targets_m

    return Search(
        draw=draw,
        rounds=placing.starts // placing.round_starts,
        enough=placing.enough,
        margins_m=placing.margins_m,
        tool=tool,
    )
