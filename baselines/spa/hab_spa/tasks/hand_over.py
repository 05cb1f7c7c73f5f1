"""Hand-over between planned skills: the arm moves to rest before the base drives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from hab_plans.motion import Motion
from hab_plans.motion_log import MotionLog
from hab_plans.protocols import NavigationRequest
from hab_plans.stage import Stage

from hab_spa.motion.drive import DriveConfig, leave
from hab_spa.motion.moves import rest
from hab_spa.motion.robot import Robot
from hab_tasks.constants import REST_POSITION_M, REST_RADIUS_M, SKILL_HORIZON_STEPS


@dataclass(frozen=True, eq=False)
class Folding:
    """Folds the arm of a robot with a scene model.

    Attributes:
        log: The robot's motions.
    """

    log: MotionLog[Robot]

    def prepare(self, stage: Stage, attempt: int) -> Motion:
        """Moves the arm to rest; backs off first if the arm has no room."""
        return fold_arm(self.log)

    def arrive(self, stage: Stage, request: NavigationRequest) -> Motion:
        """Does nothing."""
        yield from ()
        return None


def rests(robot: Robot) -> bool:
    """Returns whether the arm is at rest."""
    ee_m = robot.kinematics.ee_pose(robot.scene.arm_qpos)[:3, 3]
    return bool(np.linalg.norm(ee_m - REST_POSITION_M) < REST_RADIUS_M)


def fold_arm(log: MotionLog[Robot]) -> Motion:
    """Moves the arm to rest before driving; backs off first if the arm has no room."""
    robot = log.robot
    if rests(robot):
        return None
    failure = yield from log.timed("rest", rest(robot), SKILL_HORIZON_STEPS)
    if failure is None:
        return None
    yield from leave(robot, robot.scene.floor_map(), DriveConfig())
    return (yield from log.timed("rest", rest(robot), SKILL_HORIZON_STEPS))
