"""Building blocks of the skills: wait, follow a path, plan and move."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from dataclasses import replace

from hab_plans.motion import Command, Failure, Motion

from hab_spa.motion.follow import Follower
from hab_spa.motion.robot import Robot
from hab_spa.planning.arm_plan import PlanConfig
from hab_spa.planning.collision import ArmCollision
from hab_spa.planning.path import TimingConfig, time_path_within
from hab_spa.shapes import Array

RETURN_SHARE, REACH_SHARE = 1.0, 0.5
"""Shares of the remaining time that a motion may take."""

MEETING_STEPS = 4
"""An obstacle that was felt is within the arm's volume at these next targets."""

BACK_OFF = slice(4, 12)
"""Past targets through which the arm backs off; it lags about four targets behind."""


def wait(robot: Robot, steps: int) -> Generator[Command, None, None]:
    """Holds the arm at its latest target."""
    for _ in range(steps):
        yield robot.command()


def follow(
    robot: Robot,
    path: Array,
    share: float,
    intact: Callable[[], bool] = lambda: True,
    timing: TimingConfig | None = None,
    near_rad: float | None = None,
) -> Motion:
    """Moves the arm along a path (K, 7).

    Args:
        robot: The robot.
        path: Arm poses [rad].
        share: Share of the remaining time for the motion, within the speed limits.
        intact: Whether to continue; called at every step.
        timing: Speed limits; the robot's by default.
        near_rad: Joint tolerance at the end; the robot's by default.

    Returns:
        `Failure.EXECUTION` if the tracking error is too large, an obstacle was seen or felt, or
        `intact` returned False.
    """
    config = robot.config
    steps = int((robot.steps_left - config.follow.settle_steps) * share)
    following = config.follow if near_rad is None else replace(config.follow, settled_rad=near_rad)
    follower = Follower(time_path_within(path, steps, timing or config.timing), following)
    while True:
        target = follower.advance(robot.scene.arm_qpos)
        if follower.bumped:
            robot.scene.met(follower.rest[:MEETING_STEPS])
            for passed in follower.way_back[BACK_OFF]:
                yield robot.command(passed)
        blocked = follower.bumped or follower.lost() or robot.scene.in_the_way(follower.rest)
        if blocked or not intact():
            robot.relax()
            return Failure.EXECUTION
        if follower.settled(robot.scene.arm_qpos):
            robot.command(target)
            return None
        yield robot.command(target)


def sampled(robot: Robot, sample: Callable[[], Array]) -> Array:
    """Samples joint goals (G, 7), and adds the time to the robot's timings."""
    began = time.perf_counter()
    goals = sample()
    robot.spend("target", time.perf_counter() - began)
    return goals


def go(
    robot: Robot,
    collision: ArmCollision,
    goals: Array,
    share: float = REACH_SHARE,
    intact: Callable[[], bool] = lambda: True,
    near_rad: float | None = None,
    plan: PlanConfig | None = None,
) -> Motion:
    """Plans a path from the current arm pose to a goal (G, 7), best first, and follows it.

    `collision` must be the current model; `plan` defaults to the robot's planner parameters. See
    `follow` for the other arguments.
    """
    result = robot.plan(goals, collision, plan)
    if result.path is None:
        return result.failure
    return (yield from follow(robot, result.path, share, intact, near_rad=near_rad))
