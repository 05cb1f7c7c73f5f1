"""Building blocks of the skills: wait, follow a path, plan and move, rest (S App. D, I.1)."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from dataclasses import replace

import numpy as np
from hab_plans.motion import Command, Failure, Motion
from hab_plans.protocols import PathResult

from hab_spa.motion.follow import Follower, TimingConfig, time_path_within, tracked
from hab_spa.motion.robot import Robot
from hab_spa.planning.arm_plan import PlanConfig
from hab_spa.planning.collision import ArmCollision
from hab_spa.planning.escape import EscapeConfig, escape
from hab_spa.planning.joint_goal import sample_rest_goals
from hab_spa.shapes import Array
from hab_tasks.robots.spec import RobotSpec

RETURN_SHARE, REACH_SHARE = 1.0, 0.5
"""Shares of the remaining time that a motion may take."""

MEETING_STEPS = 4
"""An obstacle that was felt is within the arm's volume at these next targets."""

CLEAR_M, LEAVING_STEPS = 0.01, 5
"""Clearance of a careful motion, and the first steps, in which it may not have it yet."""


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
    feels: bool = True,
) -> Motion:
    """Moves the arm along a path (K, J).

    Args:
        robot: The robot.
        path: Arm poses [rad].
        share: Share of the remaining time for the motion, within the speed limits.
        intact: Whether to continue; called at every step.
        timing: Speed limits; the robot's by default.
        near_rad: Joint tolerance at the end; the robot's by default.
        feels: Whether resistance is contact with an obstacle.

    Returns:
        `Failure.EXECUTION` if the tracking error is too large, an obstacle was seen or felt, or
        `intact` returned False.
    """
    config = robot.config
    # Settling comes after the path, and needs steps too.
    steps = int((robot.steps_left - config.follow.settle_steps) * share)
    following = config.follow if near_rad is None else replace(config.follow, settled_rad=near_rad)
    if not feels:
        following = replace(following, bump_rad=np.inf)
    follower = Follower(time_path_within(path, steps, timing or config.timing), following)
    while True:
        robot.leave_trail()
        target = follower.advance(robot.scene.arm_qpos)
        bumped = follower.bumped and not robot.swings
        if bumped:
            robot.scene.met(follower.rest[:MEETING_STEPS])
            # Where the arm came from was free a moment ago; nothing else is known to be.
            for passed in robot.back_off():
                yield robot.command(passed)
        blocked = bumped or follower.lost() or robot.scene.in_the_way(follower.rest)
        if blocked or not intact():
            # Targets ahead of the arm would go on pushing against the obstacle.
            robot.relax()
            return Failure.EXECUTION
        if follower.settled(robot.scene.arm_qpos):
            # Not yielded, which would cost a step: it is noted as what the next motion starts from.
            robot.command(target)
            return None
        yield robot.command(target)


def sampled(robot: Robot, sample: Callable[[], Array]) -> Array:
    """Samples joint goals (G, J), and adds the time to the robot's timings."""
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
    timing: TimingConfig | None = None,
) -> Motion:
    """Plans a path from the current arm pose to a goal (G, J), best first, and follows it.

    `collision` must be the current model; `plan` defaults to the robot's planner parameters. See
    `follow` for the other arguments.
    """
    result = robot.plan(goals, collision, plan)
    if result.path is None:
        return result.failure
    return (yield from follow(robot, result.path, share, intact, timing, near_rad))


def tucked_rad(robot: RobotSpec) -> Array:
    """Returns the tucked arm pose (J,)."""
    return np.array(robot.tucked_qpos_rad or robot.rest_qpos_rad)


def rest(
    robot: Robot,
    intact: Callable[[], bool] = lambda: True,
    without: str | None = None,
    timing: TimingConfig | None = None,
    plan: PlanConfig | None = None,
    plans: int = 1,
) -> Motion:
    """Moves the arm to rest; first escapes from contact in a straight line.

    Args:
        robot: The robot.
        intact: Whether to continue; called at every step.
        without: Name of a body that may be touched.
        timing: Speed limits; the robot's by default.
        plan: Parameters of the motion planner; the robot's by default.
        plans: Maximum number of plans, of which the motion with the most clearance is executed.
    """
    robot.doing = "rest"
    began = time.perf_counter()
    collision = robot.scene.collision(without=without)
    goals = sample_rest_goals(collision, robot.kinematics, robot.next_seed(), robot.config.goal)
    robot.spend("target", time.perf_counter() - began)
    if not len(goals):
        return Failure.TARGET_PLAN
    ways: list[tuple[float, PathResult]] = []
    while len(ways) < plans and not (ways and ways[-1][0] == 0.0):
        way = _way_back(robot, collision, goals, plan or robot.config.plan)
        robot.spend("motion", way.seconds)
        touches = 0.0 if plans == 1 else _touches(robot, collision, way.path, timing)
        ways.append((touches, way))
    best = min(ways, key=lambda one: one[0])[1]
    if best.path is None:
        return best.failure
    return (yield from follow(robot, best.path, RETURN_SHARE, intact, timing))


def _touches(
    robot: Robot, collision: ArmCollision, path: Array | None, timing: TimingConfig | None
) -> float:
    """Returns the number of steps with less than `CLEAR_M` along a path (K, J); infinite for None.

    The arm lags behind its targets, which cuts corners.
    """
    if path is None:
        return np.inf
    config = robot.config
    targets = time_path_within(path, robot.steps_left, timing or config.timing)
    poses = tracked(targets, robot.scene.arm_qpos, config.follow)
    collision.set_margin(CLEAR_M)
    return float(np.count_nonzero(~collision.are_free(poses[LEAVING_STEPS:])))


def draw_out(robot: Robot, near_rad: float) -> Motion:
    """Retracts the hand from contact in a straight line, if there is a free one.

    Args:
        robot: The robot.
        near_rad: Joint tolerance at the end of the line.
    """
    robot.doing = "draw out"
    began, start = time.perf_counter(), robot.scene.arm_qpos.copy()
    path = escape(robot.scene.collision(), robot.kinematics, start, robot.config.escape)
    robot.spend("motion", time.perf_counter() - began)
    if len(path) > 1:
        yield from follow(robot, path, share=0.0, near_rad=near_rad)
    return None


def _way_back(robot: Robot, collision: ArmCollision, goals: Array, plan: PlanConfig) -> PathResult:
    """Escapes from contact, then plans; if that fails, escapes through deeper contact."""
    began, config = time.perf_counter(), robot.config.escape
    result = _escaped(robot, collision, goals, plan, config)
    if result.path is None:
        deeper = replace(config, touch_m=config.deeper_m)
        result = _escaped(robot, collision, goals, plan, deeper)
    return replace(result, seconds=time.perf_counter() - began)


def _escaped(
    robot: Robot, collision: ArmCollision, goals: Array, plan: PlanConfig, config: EscapeConfig
) -> PathResult:
    """Escapes from contact, then plans; without an escape, the plan starts in contact."""
    start = robot.scene.arm_qpos.copy()
    way_out = escape(collision, robot.kinematics, start, config)
    if not len(way_out):
        way_out = start[None]
    result = robot.config.planner.plan(
        way_out[-1],
        goals,
        collision,
        seed=robot.next_seed(),
        limits=plan,
        touch_m=config.touch_m,
        # The start is the tight end here: the hand is at an object, or in a fridge.
        backwards=True,
    )
    if result.path is None:
        return result
    return replace(result, path=np.concatenate((way_out, result.path[1:])))
