"""The Pick skill by sense-plan-act (S App. D): grasp the object, then rest."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from hab_plans.motion import GRASP, RELEASE, Failure, Motion

from hab_spa.motion.moves import go, rest, sampled
from hab_spa.motion.robot import Robot
from hab_spa.planning.collision import ArmCollision
from hab_spa.planning.escape import escape
from hab_spa.planning.joint_goal import (
    JUDGE_SEED,
    count_goals,
    sample_reaching_goals,
    sample_tight_goals,
    tight_search,
)
from hab_spa.shapes import Array, invert_pose


def pick(robot: Robot, number: int, take: Callable[[Robot, int], Motion] | None = None) -> Motion:
    """Grasps an object of the episode and rests; replans when motion or execution fails.

    Args:
        robot: The robot.
        number: Number of the object.
        take: Grasps it; by default as the snap grasp does.
    """
    scene, failure = robot.scene, None
    for _ in range(1 + robot.config.retries):
        failure = None
        if not scene.holds(number):
            failure = yield from (take or _take)(robot, number)
        if failure is None:
            failure = yield from rest(robot, intact=lambda: scene.holds(number))
        if failure is None or failure is Failure.TARGET_PLAN:
            break
    return failure


def pick_score(robot: Robot, number: int, base: Array, effort: int = 1) -> int:
    """Scores a base pose (3,) by the number of grasps of an object found in a few samples.

    `effort` multiplies the number of samples.
    """
    config = robot.config.goal
    starts = effort * config.judge_starts
    few = replace(config, tight_starts=starts, tight_round=starts)
    points_m = robot.scene.grasp_points_m(number, around=True)
    search = tight_search(points_m, robot.kinematics, JUDGE_SEED, few)
    return count_goals(search, robot.scene.collision(base=base), robot.kinematics, config)


def _take(robot: Robot, number: int) -> Motion:
    """Plans a grasp, reaches and grasps; in confined spaces, from all around the object."""
    robot.doing, robot.gripper = "reach", RELEASE
    if robot.scene.holding:  # a wrong object
        yield robot.command()
    failure: Failure | None = Failure.TARGET_PLAN
    for around in (False, True):
        failure = yield from _reach(robot, number, around)
        if failure is None or failure is Failure.EXECUTION:
            break
    if failure is not None:
        return failure
    return (yield from _grasp(robot, number))


def _reach(robot: Robot, number: int, around: bool) -> Motion:
    """Plans a motion to a grasp pose and executes it."""
    scene, config = robot.scene, robot.config
    collision = scene.collision()
    points_m = scene.grasp_points_m(number, around=around)
    sample = sample_tight_goals if around else sample_reaching_goals
    goals = sampled(
        robot,
        partial(sample, points_m, collision, robot.kinematics, robot.next_seed(), config.goal),
    )
    if not len(goals):
        return Failure.TARGET_PLAN
    began = time.perf_counter()
    chosen = _with_way_out(robot, number, collision, goals)
    robot.spend("target", time.perf_counter() - began)
    if not len(chosen) and not around:
        return Failure.TARGET_PLAN
    return (yield from go(robot, collision, chosen if len(chosen) else goals))


def _with_way_out(robot: Robot, number: int, collision: ArmCollision, goals: Array) -> Array:
    """Returns the goals (G, J) from which the grasped object can be retracted in a straight line.

    If the best goal is one of them, all goals are returned.
    """
    kinematics, escaping = robot.kinematics, robot.config.escape
    world_from_arm = invert_pose(collision.arm_from_world)
    chosen = []
    for i, goal in enumerate(goals):
        held = robot.scene.taking(number, world_from_arm @ kinematics.ee_pose(goal))
        if held is None:
            return goals
        if len(escape(held, kinematics, goal, escaping)):
            chosen.append(goal)
            if i == 0:
                return goals
    return np.array(chosen).reshape(-1, goals.shape[1])


def _grasp(robot: Robot, number: int) -> Motion:
    """Closes the gripper, and stores the object's upright direction."""
    scene = robot.scene
    robot.doing, robot.gripper = "grasp", GRASP
    for _ in range(robot.config.grasp_steps):
        if scene.holding:
            break
        yield robot.command()
    robot.held_up = robot.up()
    yield robot.command()  # until the object is at rest in the hand
    return None if scene.holds(number) else Failure.EXECUTION
