"""The Place skill by sense-plan-act (S App. D): transport, release, rest."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace

from hab_plans.motion import RELEASE, Command, Failure, Motion

from hab_spa.motion.moves import go, rest, sampled, wait
from hab_spa.motion.robot import Robot
from hab_spa.planning.ik import Tool
from hab_spa.planning.joint_goal import JUDGE_SEED, count_goals
from hab_spa.planning.place_goal import lowering, sample_placing_goals
from hab_spa.shapes import Array


def place(robot: Robot, number: int, loose: bool = False) -> Motion:
    """Moves the held object to its goal, releases it and rests; retries while it is held.

    A released object is not grasped again.

    Args:
        robot: The robot.
        number: Number of the object.
        loose: Whether to allow larger offsets from the goal at once.
    """
    scene = robot.scene
    failure: Failure | None = Failure.EXECUTION
    for attempt in range(1 + robot.config.retries):
        if scene.holds(number):
            failure = yield from _bring(robot, number, loose or attempt > 0)
        if failure is None:
            yield from _let_go(robot)
        if not scene.holds(number):
            break
    if scene.holds(number):
        return failure
    resting = yield from _rest_again(robot)
    return failure or resting


def place_score(robot: Robot, number: int, base: Array, effort: int = 1) -> int:
    """Scores a base pose (3,) by the number of placing poses found in a few samples.

    `effort` multiplies the number of samples.
    """
    config = robot.config
    few = replace(config.placing, round_starts=effort * config.goal.judge_starts)
    search = lowering(
        robot.scene.goal_m(number), _tool(robot), robot.kinematics, JUDGE_SEED, config.goal, few
    )
    return count_goals(search, robot.scene.collision(base=base), robot.kinematics, config.goal)


def _tool(robot: Robot) -> Tool:
    """Returns the held object's centre of mass and upright direction, if unknown the current."""
    up = robot.up() if robot.held_up is None else robot.held_up
    return Tool(point_m=robot.scene.ee_from_held(), up=up)


def _bring(robot: Robot, number: int, loose: bool) -> Motion:
    """Plans a motion to a placing pose and executes it."""
    robot.doing = "bring"
    scene, config = robot.scene, robot.config
    placing = config.placing.looser() if loose else config.placing
    if robot.held_up is None:
        robot.held_up = robot.up()
    collision = scene.collision()
    goals = sampled(
        robot,
        lambda: sample_placing_goals(
            scene.goal_m(number),
            _tool(robot),
            collision,
            robot.kinematics,
            robot.next_seed(),
            config.goal,
            placing,
        ),
    )
    if not len(goals):
        return Failure.TARGET_PLAN
    return (yield from go(robot, collision, goals, intact=lambda: scene.holds(number)))


def _let_go(robot: Robot) -> Generator[Command, None, None]:
    """Opens the gripper and waits until the object has settled."""
    robot.doing, robot.gripper, robot.held_up = "let go", RELEASE, None
    yield from wait(robot, robot.config.release_steps)


def _rest_again(robot: Robot) -> Motion:
    """Moves the arm to rest; replans when execution fails."""
    failure = None
    for _ in range(1 + robot.config.retries):
        failure = yield from rest(robot)
        if failure is not Failure.EXECUTION:
            break
    return failure
