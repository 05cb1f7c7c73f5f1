"""The Pick skill as sense, plan and act (S App. D): grasp, then back to rest with the object."""

from __future__ import annotations

from hab_spa.joint_goal import sample_reaching_goals
from hab_spa.moves import go, sampled
from hab_spa.rest import rest
from hab_spa.results import Failure
from hab_spa.robot import GRASP, RELEASE, Motion, Robot


def pick(robot: Robot, number: int) -> Motion:
    """Takes an object of the episode and rests; plans again when execution fails.

    Args:
        robot: Who does it.
        number: Number of the object.
    """
    scene, failure = robot.scene, None
    for _ in range(1 + robot.config.retries):
        failure = None
        if not scene.holds(number):
            failure = yield from _take(robot, number)
        if failure is None:
            failure = yield from rest(robot, intact=lambda: scene.holds(number))
        if failure is not Failure.EXECUTION:
            break
    return failure


def _take(robot: Robot, number: int) -> Motion:
    """Plans a grasp, goes there and grasps."""
    robot.doing, robot.gripper = "reach", RELEASE
    if robot.scene.holding:  # the wrong object
        yield robot.command()
    scene, config = robot.scene, robot.config
    collision = scene.collision()
    points_m = scene.grasp_points_m(number)
    goals = sampled(
        robot,
        lambda: sample_reaching_goals(
            points_m, collision, robot.kinematics, robot.next_seed(), config.goal
        ),
    )
    if goals.failure is not None:
        return goals.failure
    failure = yield from go(robot, collision, goals.goals)
    if failure is not None:
        return failure
    robot.doing, robot.gripper = "grasp", GRASP
    for _ in range(config.grasp_steps):
        if scene.holding:
            break
        yield robot.command()
    yield robot.command()  # the object stops moving in the hand
    return None if scene.holds(number) else Failure.EXECUTION
