"""Arm reset: return to the resting pose, with or without a held object (S App. D, I.1)."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from hab_plans.motion import Failure, Motion
from hab_plans.protocols import PathResult

from hab_spa.motion.moves import RETURN_SHARE, follow
from hab_spa.motion.robot import Robot
from hab_spa.planning.arm_plan import PlanConfig
from hab_spa.planning.collision import ArmCollision
from hab_spa.planning.escape import escape
from hab_spa.planning.joint_goal import sample_rest_goals
from hab_spa.planning.path import TimingConfig
from hab_spa.shapes import Array

TUCKED_QPOS_RAD = (-1.60, -1.22, 0.90, -0.61, 1.88, 2.14, 0.39)
"""Arm pose with arm, hand and held object above the base, within 0.35 m of its center."""


def rest(
    robot: Robot,
    intact: Callable[[], bool] = lambda: True,
    without: str | None = None,
    timing: TimingConfig | None = None,
    plan: PlanConfig | None = None,
) -> Motion:
    """Moves the arm to rest; first escapes from contact in a straight line.

    Args:
        robot: The robot.
        intact: Whether to continue; called at every step.
        without: Name of a body that may be touched.
        timing: Speed limits; the robot's by default.
        plan: Parameters of the motion planner; the robot's by default.
    """
    robot.doing = "rest"
    began = time.perf_counter()
    collision = robot.scene.collision(without=without)
    goals = sample_rest_goals(collision, robot.kinematics, robot.next_seed(), robot.config.goal)
    robot.spend("target", time.perf_counter() - began)
    if not len(goals):
        return Failure.TARGET_PLAN
    result = _way_back(robot, collision, goals, plan or robot.config.plan)
    robot.spend("motion", result.seconds)
    if result.path is None:
        return result.failure
    return (yield from follow(robot, result.path, RETURN_SHARE, intact, timing))


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
    """Escapes from contact, then plans; without an escape, the plan starts in contact."""
    began, start = time.perf_counter(), robot.scene.arm_qpos.copy()
    config = robot.config
    way_out = escape(collision, robot.kinematics, start, config.escape)
    if not len(way_out):
        way_out = start[None]
    result = config.planner.plan(
        way_out[-1],
        goals,
        collision,
        seed=robot.next_seed(),
        limits=plan,
        touch_m=config.escape.touch_m,
        backwards=True,
    )
    if result.path is not None:
        result = replace(result, path=np.concatenate((way_out, result.path[1:])))
    return replace(result, seconds=time.perf_counter() - began)
