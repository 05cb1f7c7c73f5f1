"""Motions of learned skills."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from hab_plans.motion import GRASP, RELEASE, Command, Failure, Motion
from hab_plans.stage import Stage
from hab_spa.motion.robot import Robot
from hab_spa.shapes import Array
from numpy.typing import NDArray

from hab_tasks.robots.control import commanded_arm
from hab_tasks.robots.control_modes import BASE_CELLS, STOP_SHARE
from hab_tasks.robots.kinematics import ArmKinematics
from hab_tp_srl.ending import Ending
from hab_tp_srl.policies import Decider, Turn
from hab_tp_srl.view import TaskView

WATCH_STEPS = 20
"""Interval in which a robot that navigates looks for objects: its arm may sweep one aside."""

_kinematics = cache(ArmKinematics)


@dataclass(frozen=True, kw_only=True, eq=False)
class PolicyCommand(Command):
    """The command of a policy that has yet to decide; until then, the command to hold still.

    Attributes:
        turn: The running skill.
        result: Returns the command after the policy's decision.
    """

    turn: Turn
    result: Callable[[], Command]


def learned(
    robot: Robot, stage: Stage, policy: Decider, view: TaskView, ending: Ending, point_m: Array
) -> Motion:
    """Runs a learned skill to its own end.

    Args:
        robot: The robot.
        stage: The stage.
        policy: The skill's policy.
        view: What the robot observes.
        ending: The skill's end.
        point_m: (3,) the point that it is about, in the view's frame.

    Returns:
        `Failure.TIMEOUT` if the skill does not end within its horizon, `Failure.EXECUTION` if it
        knows that it picked a wrong object, or if its agent gave up.
    """
    # As at the reset of the skill's environment: the commanded pose is the present one.
    robot.relax()
    turn = turn_of(robot, policy)

    def result() -> Command:
        robot.gripper = ending.gripper(_gripper(policy, turn.action, robot.gripper))
        return command_of(robot, policy, turn.action)

    for _ in range(policy.horizon_steps):
        robot.doing = policy.name
        was_holding = view.holding
        turn.entries = view.entries(stage, point_m, aims=not policy.finds_held)
        yield _asking(robot, turn, result)
        ending.update()
        if view.holding and not was_holding:
            robot.held_up = robot.up()  # a planned placing keeps the object upright
        if ending.over or ending.failed or turn.gave_up:
            robot.gripper = ending.after()
            return None if ending.over else Failure.EXECUTION
    robot.gripper = ending.after()
    return Failure.TIMEOUT


def learned_navigation(robot: Robot, stage: Stage, turn: Turn, view: TaskView) -> Motion:
    """Drives by a learned policy until its stop action.

    Args:
        robot: The robot.
        stage: The stage before which it drives.
        turn: The policy with its memory.
        view: What the robot observes.

    Returns:
        `Failure.TIMEOUT` if there is no stop within the policy's horizon.
    """
    policy, point_m = turn.policy, view.point(stage)

    def result() -> Command:
        # The mask of Navigate: what is held stays held, and nothing else is grasped.
        robot.gripper = GRASP if robot.gripper == GRASP and view.holding else RELEASE
        return command_of(robot, policy, turn.action)

    for step in range(policy.horizon_steps):
        robot.doing = policy.name
        if view.sees and step % WATCH_STEPS == 0:
            view.see_all(view.look(robot.spec))
        turn.entries, turn.base = view.entries(stage, point_m), view.base
        yield _asking(robot, turn, result)
        if np.abs(velocities(policy, turn.action)).max() <= STOP_SHARE:
            return None
    return Failure.TIMEOUT


def command_of(robot: Robot, policy: Decider, action: NDArray[Any]) -> Command:
    """Returns the command that does what an action does in the skill's environment.

    Args:
        robot: The robot, with its latest commanded arm pose.
        policy: The policy.
        action: (A,) an action of its control mode.
    """
    arm_rad, arm = None, policy.control.arm
    if arm != "still":
        entries = action[: policy.control.arm_size]
        moved = commanded_arm(arm, robot.arm_target_rad, entries, _kinematics(robot.spec))
        arm_rad = moved.astype(np.float32).astype(float)  # as the controller keeps it
    return robot.command(arm_rad, base=velocities(policy, action))


def velocities(policy: Decider, action: NDArray[Any]) -> tuple[float, float]:
    """Returns the base velocities of an action, relative to their maximum."""
    if policy.control.base == "still":
        return 0.0, 0.0
    if policy.control.base == "discrete":
        return BASE_CELLS[int(action[0])]
    forward, turning = action[-2:].tolist()
    return forward, turning


def _gripper(policy: Decider, action: NDArray[Any], now: float) -> float:
    """Returns the gripper entry of an action; the present one if it has none."""
    arm = policy.control.arm
    return now if arm == "still" else float(action[policy.control.arm_size])


def turn_of(robot: Robot, policy: Decider) -> Turn:
    """Returns a policy that begins."""
    return Turn(policy=policy, random=np.random.default_rng(robot.next_seed()))


def _asking(robot: Robot, turn: Turn, result: Callable[[], Command]) -> PolicyCommand:
    arm_rad, gripper = robot.arm_target_rad, robot.gripper
    return PolicyCommand(arm_rad=arm_rad, gripper=gripper, turn=turn, result=result)
