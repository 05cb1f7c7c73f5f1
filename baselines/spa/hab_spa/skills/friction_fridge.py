"""The fridge skills by two fingers, which hold the bar of the handle by contact alone."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace

import numpy as np
from hab_plans.motion import RELEASE, Command, Failure, Motion

from hab_spa.motion.moves import follow, go
from hab_spa.motion.robot import Robot
from hab_spa.planning.joint_goal import GoalConfig
from hab_spa.skills.bar import BarConfig, close_around, let_go, way_to_bar
from hab_spa.skills.fridge.arc import ArcConfig, DoorPath
from hab_spa.skills.fridge.base_poses import BasePoseConfig
from hab_spa.skills.fridge.config import FridgeConfig
from hab_spa.skills.fridge.door_paths import DoorPathConfig
from hab_spa.skills.fridge.skill import FridgeMotion
from hab_spa.skills.fridge.tow import TowConfig
from hab_tasks.articulations import FRIDGE

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

GOALS = GoalConfig(goals=14, same_goal_rad=0.3)
CONFIG = FridgeConfig(
    pace=2.2,
    as_good_steps=8.0,
    rest_paces=(1.0, 1.3, 1.6, 2.4),
    rest_plans=8,
    back_rad=0.02,
    base_pose=BasePoseConfig(
        door_path=DoorPathConfig(arc=ARC, bar=BAR, quick=GOALS, comparison=GOALS, final=GOALS)
    ),
)


def open_fridge_by_friction(robot: Robot, number: int) -> Motion:
    """Opens the fridge by more than 90 degrees and rests beside the door; see `open_fridge`."""
    return (yield from _Gripping(robot, number, True, FRIDGE.opening_region, CONFIG).move())


def close_fridge_by_friction(robot: Robot, number: int) -> Motion:
    """Closes the fridge and rests; see `close_fridge`."""
    return (yield from _Gripping(robot, number, False, FRIDGE.closing_region, CONFIG).move())


class _Gripping(FridgeMotion):
    """Opens or closes one door by the bar of its handle."""

    def _take(self, candidates: list[DoorPath]) -> Motion:
        """Reaches for the bar, comes straight to it, and closes the fingers."""
        robot, config = self._robot, self._config
        robot.doing, robot.gripper = "reach", RELEASE
        ways = np.array([way_to_bar(robot.kinematics, one.goal, BAR) for one in candidates])
        near_rad, timing = BAR.near_rad, replace(robot.config.timing, paces=config.rest_paces[-2:])
        failure = yield from go(
            robot,
            robot.scene.collision(),
            ways[:, 0],
            config.reach_share,
            near_rad=near_rad,
            plan=config.plan,
            timing=timing,
        )
        if failure is None:
            gaps_rad = np.abs(ways[:, 0] - robot.arm_target_rad).max(axis=1)
            failure = yield from follow(
                robot, ways[gaps_rad.argmin()], 0.0, timing=timing, near_rad=near_rad
            )
        if failure is not None:
            return failure
        if (yield from close_around(robot, self._number, BAR)):
            return None
        yield from let_go(robot, BAR)
        return Failure.EXECUTION

    @property
    def _held(self) -> bool:
        """Whether the bar, which is vertical, is between the fingers.

        When the door speeds up or slows down, one of them may lose contact for a few steps.
        """
        handle_m = self._robot.scene.articulation(self._number).handle_m
        gap_m = handle_m[:2] - self._robot.world_from_ee[:2, 3]
        return float(np.linalg.norm(gap_m)) < BETWEEN_M

    def _let_go(self) -> Generator[Command, None, None]:
        """Opens the fingers, and draws the hand back."""
        yield from let_go(self._robot, BAR)
