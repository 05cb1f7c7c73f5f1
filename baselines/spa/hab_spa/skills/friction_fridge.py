"""The fridge skills by two fingers, which hold the bar of the handle by contact alone."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace

import numpy as np
from hab_plans.motion import GRASP, RELEASE, Command, Failure, Motion

from hab_spa.motion.follow import TimingConfig
from hab_spa.motion.moves import follow, go, wait
from hab_spa.motion.robot import Robot
from hab_spa.planning.joint_goal import GoalConfig
from hab_spa.shapes import Array
from hab_spa.skills.bar import BarConfig, close_around, let_go, way_to_bar
from hab_spa.skills.fridge.arc import ArcConfig, DoorPath
from hab_spa.skills.fridge.base_poses import BasePoseConfig, SelectedBasePose
from hab_spa.skills.fridge.config import FridgeConfig
from hab_spa.skills.fridge.door_paths import DoorPathConfig
from hab_spa.skills.fridge.drive_and_reach import drive_and_reach
from hab_spa.skills.fridge.skill import FridgeMotion
from hab_spa.skills.fridge.tow import TowConfig
from hab_tasks.articulations import Rectangle

BAR = BarConfig(
    along_m=(0.0, -0.06, 0.06, -0.12, 0.12),
    about_rad=(0.0, 0.35, -0.35, 0.7, -0.7, 1.05, -1.05),
    aside_rad=(0.0, 0.3, -0.3),
)
ARC = ArcConfig(
    orientations=((1.0, 0.1), (0.75, 0.1), (0.5, 0.1)),
    draws_in=False,
    again_steps=(80.0, 60.0),
    tow=TowConfig(count=10, goals=10),
)
"""The hand turns with the door, or less, about the bar."""

BETWEEN_M = 0.04
"""A bar so near to the point between the fingers, whose gap is 10 cm, is between them."""

FAST_PACES, CLOSING_STEPS = (1.6, 2.4), 3
"""Paces where neither force nor clearance matters, and steps in which empty fingers close."""

GOALS = GoalConfig(goals=14, same_goal_rad=0.3)


def _held_by_bar(arc: ArcConfig) -> BasePoseConfig:
    paths = DoorPathConfig(arc=arc, bar=BAR, quick=GOALS, comparison=GOALS, final=GOALS)
    return BasePoseConfig(door_path=paths)


OPEN = FridgeConfig(
    pace=2.2,
    as_good_steps=8.0,
    rest_paces=(1.0, 1.3, 1.6, 2.4),
    rest_plans=8,
    back_rad=0.02,
    base_pose=_held_by_bar(ARC),
)
"""With the bar of the handle between the fingers."""

OPEN_ON = replace(
    OPEN,
    grasps_m=(),
    around_m=((0.06, -0.14), (0.0, -0.14), (0.1, -0.12), (-0.1, -0.14)),
    base_pose=BasePoseConfig(),
)
"""From inside, by a push alone, once the bar has been held."""

CLOSE = replace(
    OPEN, brake_steps=1, hold_steps=4, base_pose=_held_by_bar(ArcConfig(draws_in=False))
)
CLOSE_ON = replace(CLOSE, around_m=(), base_pose=BasePoseConfig())


def open_fridge_by_friction(robot: Robot, number: int, region: Rectangle | None = None) -> Motion:
    """Opens the fridge by more than 90 degrees and rests beside the door; see `open_fridge`."""
    return (yield from _ByFriction(robot, number, True, region, OPEN, OPEN_ON).move())


def close_fridge_by_friction(robot: Robot, number: int, region: Rectangle | None = None) -> Motion:
    """Closes the fridge and rests; see `close_fridge`."""
    return (yield from _ByFriction(robot, number, False, region, CLOSE, CLOSE_ON).move())


def push_fridge_closed(robot: Robot, number: int) -> Motion:
    """Closes the fridge by a push alone and rests: a task does not ask who holds the handle."""
    return (yield from _ByFriction(robot, number, False, None, CLOSE_ON, CLOSE_ON).move())


class _ByFriction(FridgeMotion):
    """Moves one door by the bar of its handle; once it has been held, also by a push alone.

    A door that closes is only pushed: fingers around its bar would draw it open again when the arm
    moves to rest.
    """

    def __init__(
        self,
        robot: Robot,
        number: int,
        out: bool,
        region: Rectangle | None,
        config: FridgeConfig,
        then: FridgeConfig,
    ) -> None:
        super().__init__(robot, number, out, region, config)
        self._then, self._grips = then, False

    def _find_candidates(self) -> list[DoorPath]:
        return [] if self._done else super()._find_candidates()

    def _drive(self, chosen: SelectedBasePose) -> Generator[Command, None, bool]:
        """Drives, and reaches for the handle on the way where there is room for both."""
        robot, config, goals = self._robot, self._config, chosen.goals
        if chosen.maneuver is None:
            return True
        if config.base_pose.door_path.bar is not None:
            goals = self._ways_to_bar(goals)[:, 0]
        maneuver = chosen.maneuver
        return (yield from drive_and_reach(robot, maneuver, goals, config.maneuver, config.plan))

    def _take(self, candidates: list[DoorPath]) -> Motion:
        goals = np.array([one.goal for one in candidates])
        if self._config.base_pose.door_path.bar is None:
            self._robot.gripper = GRASP
            return (yield from self._reach(goals, self._config.at_handle_rad))
        failure = yield from self._grip(goals)
        self._grips = failure is None
        if failure is None and not self._out:
            yield from self._let_go()
            self._robot.gripper = GRASP
            yield from wait(self._robot, CLOSING_STEPS)
        return failure

    def _grip(self, goals: Array) -> Motion:
        """Comes straight to the bar, and closes the fingers."""
        robot = self._robot
        robot.gripper = RELEASE
        ways, near_rad = self._ways_to_bar(goals), BAR.near_rad
        failure = yield from self._reach(ways[:, 0], near_rad)
        if failure is None:
            gaps_rad = np.abs(ways[:, 0] - robot.arm_target_rad).max(axis=1)
            way = ways[gaps_rad.argmin()]
            failure = yield from follow(robot, way, 0.0, timing=self._timing, near_rad=near_rad)
        if failure is not None:
            return failure
        if (yield from close_around(robot, self._number, BAR)):
            return None
        yield from let_go(robot, BAR, self._timing)
        return Failure.EXECUTION

    def _ways_to_bar(self, goals: Array) -> Array:
        """Returns the straight ways (G, K, J) to grasps of the bar (G, J)."""
        return np.array([way_to_bar(self._robot.kinematics, goal, BAR) for goal in goals])

    def _reach(self, goals: Array, near_rad: float) -> Motion:
        """Moves the arm to one of the goals (G, J)."""
        robot, config, timing = self._robot, self._config, self._timing
        robot.doing, collision, share = "reach", robot.scene.collision(), config.reach_share
        return (
            yield from go(
                robot, collision, goals, share, near_rad=near_rad, plan=config.plan, timing=timing
            )
        )

    @property
    def _timing(self) -> TimingConfig:
        """Speed limits with `FAST_PACES`."""
        return replace(self._robot.config.timing, paces=FAST_PACES)

    @property
    def _held(self) -> bool:
        """Whether the bar, which is vertical, is between the fingers, or need not be.

        When the door speeds up or slows down, one of them may lose contact for a few steps.
        """
        if not self._grips:
            return True
        handle_m = self._robot.scene.articulation(self._number).handle_m
        gap_m = handle_m[:2] - self._robot.world_from_ee[:2, 3]
        return float(np.linalg.norm(gap_m)) < BETWEEN_M

    def _let_go(self) -> Generator[Command, None, None]:
        """Opens the fingers and draws the hand back, or waits while a pushed door swings on."""
        if not self._grips:
            yield from self._wait()
            return
        yield from let_go(self._robot, BAR, self._timing)
        self._grips, self._config = False, self._then
