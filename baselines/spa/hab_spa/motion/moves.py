"""What the skills' motions are made of: follow a path, wait, plan and go."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from dataclasses import replace

from hab_spa.motion.follow import Follower
from hab_spa.motion.robot import Command, Motion, Robot
from hab_spa.planning.arm_plan import Ends, PlanConfig, plan_path
from hab_spa.planning.collision import ArmCollision
from hab_spa.planning.path import TimingConfig, time_path_within
from hab_spa.results import Failure, GoalResult
from hab_spa.shapes import Array

RETURN_SHARE, REACH_SHARE = 1.0, 0.5
"""Share of the time left that a motion may take: half of it on the way there."""

MEETING_STEPS = 4
"""What the arm meets with is where it would have been within so many steps."""

BACK_OFF = slice(4, 12)
"""Which of its last targets the arm goes back through: it is about four behind the latest."""


def wait(robot: Robot, steps: int) -> Generator[Command, None, None]:
    """Keeps the arm where it was told to be."""
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
        robot: Who moves.
        path: Arm poses [rad].
        share: Of the time left that the motion may take, if the limits of speed allow.
        intact: Whether it makes sense to go on; asked at every step.
        timing: Other limits of speed than the robot's usual ones.
        near_rad: The end is reached when every joint is this near to it; None: as usual.

    Returns:
        `Failure.EXECUTION` when the arm does not keep up, when something was seen or felt in its
        way, or when it made no sense to go on.
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


def sampled(robot: Robot, sample: Callable[[], GoalResult]) -> GoalResult:
    """Returns goals of the arm, and counts the time that took, the collision model's included."""
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
    """Plans from where the arm is to one of the goals (G, 7), the first where possible, and goes.

    `collision` must be the model of this moment, `plan` are other numbers of the planner than the
    robot's usual ones; the others are as for `follow`.
    """
    start = robot.scene.arm_qpos.copy()
    ends = [Ends(open=start, tight=goal) for goal in goals]
    plan = plan or robot.config.plan
    result = plan_path(collision, robot.kinematics, ends, robot.next_seed(), plan)
    robot.spend("motion", result.seconds)
    if result.path is None:
        return result.failure
    return (yield from follow(robot, result.path, share, intact, near_rad=near_rad))
