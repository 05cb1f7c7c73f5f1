"""Search for pulls of the fridge door from given base poses."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hab_spa.motion.robot import Robot
from hab_spa.planning.joint_goal import GoalConfig, apart, sample_reaching_goals
from hab_spa.shapes import Array
from hab_spa.skills.bar import BarConfig, bar_goals, bar_grasps, same_grasps
from hab_spa.skills.fridge.arc import ArcConfig, Arcs, DoorPath, Pull, best_first
from hab_spa.skills.fridge.door import Door
from hab_spa.skills.fridge.tow import Free, tows
from hab_tasks.privileged import ArticulationState


@dataclass(frozen=True, kw_only=True)
class DoorPathConfig:
    """Parameters of the search for pulls.

    Attributes:
        resting_rad: Joint tolerance of the resting pose.
        rest_m: Clearance of the resting arm.
        around_m: Radius of the collision model around the shoulder at the central base pose.
        quick, comparison, final: Parameters of grasp sampling for a first score, for comparing base
            poses, and at the final base pose.
        arc: Parameters of following the arc.
        bar: Grasps of the bar of the handle by two fingers; None for the snap grasp.
    """

    resting_rad: float = 0.6
    rest_m: float = 0.005
    around_m: float = 2.2
    quick: GoalConfig = field(
        default_factory=lambda: GoalConfig(
            starts_per_point=20, round_starts=20, enough=10, goals=3, same_goal_rad=0.3
        )
    )
    comparison: GoalConfig = field(
        default_factory=lambda: GoalConfig(
            starts_per_point=60, round_starts=60, enough=30, goals=8, same_goal_rad=0.2
        )
    )
    final: GoalConfig = field(
        default_factory=lambda: GoalConfig(
            starts_per_point=300, round_starts=150, enough=120, goals=30, same_goal_rad=0.2
        )
    )
    arc: ArcConfig = field(default_factory=ArcConfig)
    bar: BarConfig | None = None


class DoorPathSearch:
    """Finds pulls of a door in its current state, with one collision model for all base poses.

    Attributes:
        collision: The collision model; its robot and door are moved.
    """

    def __init__(
        self,
        robot: Robot,
        articulation: ArticulationState,
        pull: Pull,
        free: Free,
        middle: Array,
        config: DoorPathConfig,
    ) -> None:
        """Builds the collision model.

        Args:
            robot: The robot.
            articulation: The door.
            pull: Specification of the door motion.
            free: Base poses that are allowed during a pull.
            middle: Base pose (3,) at the center of the candidates.
            config: Parameters.
        """
        self._robot, self._articulation, self._pull = robot, articulation, pull
        self._free, self._config = free, config
        self._door = Door(articulation)
        self._arcs = Arcs(articulation, robot.kinematics, pull, config.arc)
        scene = robot.scene
        self.collision = scene.collision(base=middle, reach_m=config.around_m)
        # A closing door yields to a hand in front of it.
        self._yielding = (
            self.collision
            if pull.opening
            else scene.collision(base=middle, without=articulation.body, reach_m=config.around_m)
        )

    def find(
        self, pose: Array | None, goal: GoalConfig, near: Array | None = None
    ) -> list[DoorPath]:
        """Returns the pulls from a base pose (3,), best first.

        The base moves as well if the arm alone cannot move the door completely.

        Args:
            pose: Hypothetical base pose; None for the current one.
            goal: Parameters of grasp sampling.
            near: Grasp poses (G, J) of pulls that were found from almost the same base pose.
        """
        scene = self._robot.scene
        base = self._robot.base if pose is None else pose
        self._stand_at(base)
        if pose is not None:
            self.collision.set_margin(self._config.rest_m)
            if not self.collision.is_free(scene.arm_qpos):
                return []
        goals = self._goals(goal, near)
        if not len(goals):
            return []
        standing = np.repeat(base[None, None], len(self._arcs.joints), axis=1)
        candidates = best_first(self._along(goals, standing))
        if candidates and candidates[0].complete:
            return candidates
        tow = self._config.arc.tow
        short = [not self._pull.is_complete(float(joint)) for joint in self._arcs.joints]
        required = min(1 + sum(short), len(short))
        moving = tows(base, self._arcs.joints, required, self._door, self._free, tow)
        return best_first(candidates + self._along(goals[: tow.goals], moving))

    def _stand_at(self, base: Array) -> None:
        """Sets the robot to a base pose (3,) and the door to its current position."""
        for model in (self.collision, self._yielding):
            model.stand_at(base)
            model.move(self._articulation.body, np.eye(4))

    def _goals(self, config: GoalConfig, near: Array | None) -> Array:
        """Returns grasp poses (G, J), first those near others."""
        robot, door = self._robot, self._door
        points_m = np.array([door.point(door.joint, *grasp) for grasp in self._pull.grasps_m])
        seed, here, arm = robot.next_seed(), robot.scene.arm_qpos, robot.kinematics
        if self._config.bar is not None:
            return self._bar_goals(seed, config, self._config.bar, near)
        goals = sample_reaching_goals(points_m, self.collision, arm, seed, config)
        if np.abs(here - arm.rest_rad).max() > self._config.resting_rad:
            # After a pull, grasp poses near the current one need little motion.
            again = sample_reaching_goals(points_m, self.collision, arm, seed, config, here)
            goals = np.concatenate((goals, again))
        for pose in () if near is None else near[::-1]:
            some = sample_reaching_goals(
                points_m, self.collision, arm, seed, self._config.quick, pose
            )
            goals = np.concatenate((some, goals))
        return goals

    def _bar_goals(
        self, seed: int, config: GoalConfig, bar: BarConfig, near: Array | None
    ) -> Array:
        """Returns arm poses (G, J) with the bar of the handle between the fingers."""
        door, arm = self._door, self._robot.kinematics
        face, out = door.points(door.joint, np.array(((0.0, 0.0), (0.0, 1.0))))
        grasps = bar_grasps(face - out, np.array((0.0, 0.0, 1.0)), door.handle(door.joint), bar)
        goals = apart(bar_goals(arm, self.collision, grasps, seed, bar)[0], config)
        if near is None or not len(near):
            return goals
        return np.concatenate((same_grasps(arm, self.collision, grasps, near, bar), goals))

    def _along(self, goals: Array, moving: Array) -> list[DoorPath]:
        """Returns the pulls from grasp poses (G, J) with base motions (T, K, 3)."""
        arcs, here = self._arcs, self._robot.scene.arm_qpos
        if self._pull.opening or not len(goals) or not len(moving):
            return arcs.candidates(here, goals, self.collision, moving)
        if self._config.bar is not None:
            return arcs.candidates(here, goals, self._yielding, moving)
        self._stand_at(moving[0, 0])
        before = arcs.are_before(goals, self.collision)
        candidates = arcs.candidates(here, goals[~before], self.collision, moving)
        return candidates + arcs.candidates(here, goals[before], self._yielding, moving)
