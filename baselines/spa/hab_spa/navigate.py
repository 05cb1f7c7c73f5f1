"""The ways to come from one skill to the next: oracle and teleport (S H.2, Navigate)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hab_spa.drive import DriveConfig, drive_to
from hab_spa.moves import wait
from hab_spa.robot import Motion, Robot
from hab_spa.shapes import Array
from hab_tasks.navigation import NavigationMap

Navigator = Callable[[Robot, NavigationMap, Array], Motion]
"""(robot, map, base pose (3,)) -> the way there."""

SETTLE_STEPS = 3


def oracle(robot: Robot, map_: NavigationMap, goal: Array) -> Motion:
    """Follows the shortest way on the true floor, with the physics of the real base."""
    robot.doing = "navigate"
    return (yield from drive_to(robot, map_, goal, DriveConfig()))


def teleport(robot: Robot, map_: NavigationMap, goal: Array) -> Motion:
    """Is there at once; needs a control mode that can set the base's pose."""
    robot.doing = "teleport"
    yield robot.command(pose=np.asarray(goal, dtype=float))
    yield from wait(robot, SETTLE_STEPS)
    return None


NAVIGATORS: dict[str, Navigator] = {"oracle": oracle, "teleport": teleport}
"""Option ``navigation`` -> how the robot gets about."""
