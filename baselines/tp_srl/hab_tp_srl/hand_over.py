"""Hand-over between skills: the hand is emptied, the arm comes to rest (S H.2)."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from hab_plans.motion import RELEASE, Motion
from hab_plans.motion_log import MotionLog
from hab_plans.protocols import NavigationRequest, Navigator
from hab_plans.stage import Stage
from hab_spa.motion.moves import RETURN_SHARE, follow, wait
from hab_spa.motion.robot import Robot
from hab_spa.tasks.navigate import fold_arm, rests

from hab_tasks.constants import SKILL_HORIZON_STEPS
from hab_tp_srl.options import TeamOptions

RELEASE_STEPS = 4
RESET_RAD = 0.05
"""Largest joint error of an arm that has been reset (Habitat's `ResetArmSkill`)."""

RESET_STEPS = 100


class ReturningNavigator(Navigator[Robot], Protocol):
    """A navigator that can make room for the arm."""

    def back_off(self, robot: Robot) -> Motion:
        """Drives straight back, if there is room."""
        ...

    def go_again(self, robot: Robot, request: NavigationRequest) -> Motion:
        """Returns from there."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class Resetting:
    """Moves the arm to rest between the skills of one robot.

    Attributes:
        log: The robot's motions.
        options: The agent's options.
        navigator: Moves the base.
        learned: Skills by policies.
    """

    log: MotionLog[Robot]
    options: TeamOptions
    navigator: ReturningNavigator
    learned: Collection[str]

    def prepare(self, stage: Stage, attempt: int) -> Motion:
        """Moves the arm to rest before a stage, and opens a hand that holds something else.

        Before a planned skill and to recover from a failure, the arm's motion is planned if it can
        be. Before a learned skill, the arm is reset as by Habitat's ``reset_arm``: a hand that is
        merely near its resting position can hold an object below the top of a table.
        """
        log, options = self.log, self.options
        if not rests(log.robot) and (options.recovers or self._is_planned(stage)):
            if options.privileged:
                yield from fold_arm(log)
            else:
                yield from log.timed("rest", reset_arm(log.robot), SKILL_HORIZON_STEPS)
        yield from self._reset_arm(stage)
        if options.recovers and self._holds_other(stage, attempt):
            yield from log.timed("release", self._release(), RELEASE_STEPS)
        return None

    def arrive(self, stage: Stage, request: NavigationRequest) -> Motion:
        """Moves the arm to rest where a learned skill begins.

        A hand that met a wall on the way is reset farther back, where the arm has room. If
        something is between the hand and its resting position even there, the way is planned.
        """
        log, navigator, robot = self.log, self.navigator, self.log.robot
        yield from self._reset_arm(stage)
        if not self._needs_reset(stage):
            return None
        steps = navigator.horizon_steps
        yield from log.timed("navigate", navigator.back_off(robot), steps)
        yield from self._reset_arm(stage)
        if self._needs_reset(stage) and self.options.privileged:
            yield from fold_arm(log)
            yield from self._reset_arm(stage)
        yield from log.timed("navigate", navigator.go_again(robot, request), steps)
        return None

    def _holds_other(self, stage: Stage, attempt: int) -> bool:
        """Returns whether the hand holds what it should not at the start of a stage."""
        scene = self.log.robot.scene
        if stage.skill == "place" or not scene.holding:
            return False
        if stage.skill == "pick" and (self.options.true_knowledge or self.options.feels):
            return not scene.holds(stage.object)
        # After a pick that timed out, it may be the target.
        return stage.skill != "pick" or attempt == 0

    def _release(self) -> Motion:
        """Opens the hand."""
        self.log.robot.gripper = RELEASE
        yield from wait(self.log.robot, RELEASE_STEPS)
        return None

    def _is_planned(self, stage: Stage) -> bool:
        return stage.skill not in self.learned

    def _needs_reset(self, stage: Stage) -> bool:
        gap_rad = np.abs(self.log.robot.scene.arm_qpos - self.log.robot.kinematics.rest_rad).max()
        resets = self.options.resets_arm and not self._is_planned(stage)
        return resets and gap_rad > RESET_RAD

    def _reset_arm(self, stage: Stage) -> Motion:
        """Moves the arm to rest for a learned skill."""
        if self._needs_reset(stage):
            yield from self.log.timed("reset", reset_arm(self.log.robot), RESET_STEPS)
        return None


def reset_arm(robot: Robot) -> Motion:
    """Moves the arm straight to its resting configuration."""
    path = np.stack((robot.scene.arm_qpos, robot.kinematics.rest_rad))
    return (yield from follow(robot, path, RETURN_SHARE))
