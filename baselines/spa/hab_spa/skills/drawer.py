"""The drawer skills by sense-plan-act: grasp the handle, follow its line, release, rest."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from hab_plans.motion import GRASP, RELEASE, Failure, Motion

from hab_spa.motion.follow import TimingConfig
from hab_spa.motion.moves import follow, rest, wait
from hab_spa.motion.robot import Robot
from hab_spa.planning.arm_plan import PlanConfig
from hab_spa.planning.collision import ArmCollision
from hab_spa.shapes import Array
from hab_spa.skills.drawer_lines import HandleLines, Line, LineConfig
from hab_tasks.articulations import DRAWER
from hab_tasks.privileged import ArticulationState
from hab_tasks.world.navigation import NavigationMap

MAX_SCORE = 12
"""Maximum of `drawer_score`: many grasps move the drawer all the way."""

SCORING = LineConfig(
    starts=200, rounds=1, step_m=0.06, jump_rad=1.0, lines=MAX_SCORE // 2, apart_rad=0.0
)


@dataclass(frozen=True, kw_only=True)
class DrawerConfig:
    """Parameters of the drawer skills.

    Attributes:
        rounds: Maximum number of grasps, if one does not move the drawer all the way.
        open_share: Target opening as a share of the joint range; closing leaves 1 - open_share.
        spare_m: The handle is not grasped again if the joint is this far beyond the threshold.
        line: Parameters of grasps and lines.
        timing: Speed limits along a line and beside the drawer.
        reach_share: Share of the remaining time for reaching the handle.
        line_share: Share of the remaining time for the line; both within the speed limits.
        plan: Parameters of the motion planner; more computing, as short paths matter.
        grasp_steps: Maximum steps until the handle is held.
        still_steps: Steps to hold the handle at the end, until the drawer is still.
        scoring: Parameters of the coarse lines that score a base pose.
        far_m: Candidate distances of the base from the handle, best first.
        aside_m: Candidate lateral offsets of the base, best first.
    """

    rounds: int = 3
    open_share: float = 0.985
    spare_m: float = 0.005
    line: LineConfig = field(default_factory=LineConfig)
    timing: TimingConfig = field(default_factory=lambda: TimingConfig(paces=(0.5, 0.7, 1.0, 1.3)))
    reach_share: float = 0.12
    line_share: float = 0.25
    plan: PlanConfig = field(
        default_factory=lambda: PlanConfig(most_checks=40_000, good_rad=1.2, improve_checks=8_000)
    )
    grasp_steps: int = 5
    still_steps: int = 3
    scoring: LineConfig = field(default_factory=lambda: SCORING)
    far_m: tuple[float, ...] = (0.65, 0.72, 0.58, 0.8)
    aside_m: tuple[float, ...] = (0.0, 0.15, -0.15, 0.3, -0.3)


def open_drawer(robot: Robot, number: int, config: DrawerConfig | None = None) -> Motion:
    """Grasps the handle, pulls the drawer open, releases it and rests.

    Args:
        robot: The robot.
        number: Number of the drawer among the episode's articulations.
        config: Parameters.
    """
    return (yield from slide(robot, number, True, config or DrawerConfig()))


def close_drawer(robot: Robot, number: int, config: DrawerConfig | None = None) -> Motion:
    """Grasps the handle, pushes the drawer closed, releases it and rests; see `open_drawer`."""
    return (yield from slide(robot, number, False, config or DrawerConfig()))


def drawer_score(
    robot: Robot, number: int, base: Array, out: bool, config: DrawerConfig | None = None
) -> int:
    """Scores a base pose (3,) for moving a drawer, from 0 to `MAX_SCORE`.

    Up to half of the score is for a part of the travel; the rest is for the number of grasps that
    move the drawer all the way.

    Args:
        robot: The robot.
        number: Number of the drawer.
        base: The base pose.
        out: Whether to open the drawer.
        config: Parameters.
    """
    config, articulation = config or DrawerConfig(), robot.scene.articulation(number)
    way_m = travel_m(articulation, out, config)
    lines = HandleLines(robot, articulation, way_m, config.scoring, base).find(seed=0)
    complete = sum(found.missing_m <= config.scoring.slack_m for found in lines)
    if complete or not lines:
        return complete + (MAX_SCORE // 2 if complete else 0)
    share = 1.0 - min(found.missing_m for found in lines) / abs(way_m)
    return int(share * MAX_SCORE / 2)


def drawer_base_poses(
    robot: Robot, number: int, map_: NavigationMap, config: DrawerConfig | None = None
) -> Array:
    """Returns free base poses (K, 3) in a rectangle in front of a drawer, facing its handle.

    Args:
        robot: The robot.
        number: Number of the drawer.
        map_: The floor map.
        config: Parameters.
    """
    config, articulation = config or DrawerConfig(), robot.scene.articulation(number)
    ahead = articulation.axis[:2] / np.linalg.norm(articulation.axis[:2])
    aside = np.array((-ahead[1], ahead[0]))
    poses = []
    for far_m in config.far_m:
        for aside_m in config.aside_m:
            position = articulation.handle_m[:2] + far_m * ahead + aside_m * aside
            gap = articulation.handle_m[:2] - position
            if map_.is_free(position):
                poses.append((*position, np.arctan2(gap[1], gap[0])))
    return np.array(poses).reshape(-1, 3)


def slide(
    robot: Robot,
    number: int,
    out: bool,
    config: DrawerConfig,
    move: Callable[[Robot, int, bool, DrawerConfig], Motion] | None = None,
) -> Motion:
    """Moves a drawer, with several grasps if one does not move it all the way.

    Args:
        robot: The robot.
        number: Number of the drawer.
        out: Whether to open it.
        config: Parameters.
        move: Moves it with one grasp; None for the snap grasp.
    """
    scene, failure, began = robot.scene, None, robot.steps
    for _ in range(config.rounds):
        if _is_done(scene.articulation(number), out, config.spare_m):
            break
        failure = yield from (move or _move)(robot, number, out, config)
        if failure is Failure.TARGET_PLAN:
            break
    if failure is not None and robot.steps == began:
        return failure
    # Touching the drawer on the way to rest may push it all the way.
    rested = yield from rest(robot, timing=config.timing)
    if rested is not None:  # beside an open drawer there may be no path without contact
        rested = yield from rest(
            robot, without=scene.articulation(number).body, timing=config.timing
        )
    return rested if _is_done(scene.articulation(number), out) else failure or Failure.EXECUTION


def _move(robot: Robot, number: int, out: bool, config: DrawerConfig) -> Motion:
    """Reaches for the handle, moves it along a line and releases it."""
    scene, articulation = robot.scene, robot.scene.articulation(number)
    robot.doing, robot.gripper = "reach", RELEASE
    if scene.holding:
        return Failure.TARGET_PLAN
    began = time.perf_counter()
    hand = HandleLines(robot, articulation, travel_m(articulation, out, config), config.line)
    lines = hand.find(robot.next_seed())
    robot.spend("target", time.perf_counter() - began)
    if not lines:
        return Failure.TARGET_PLAN
    failure = yield from _reach(robot, hand.collision, lines, config)
    if failure is None:
        failure = yield from _grasp(robot, number, config)
    if failure is not None:
        return failure
    robot.doing, here = "pull" if out else "push", scene.arm_qpos
    line = min(lines, key=lambda line: float(np.linalg.norm(line.poses[0] - here)))
    held = lambda: scene.articulation(number).held  # noqa: E731
    failure = yield from follow(
        robot, line.poses, config.line_share, held, config.timing, feels=False
    )
    robot.relax()
    yield from wait(robot, config.still_steps)
    robot.doing, robot.gripper = "let go", RELEASE
    yield from wait(robot, robot.config.release_steps)
    return failure


def _reach(
    robot: Robot, collision: ArmCollision, lines: list[Line], config: DrawerConfig
) -> Motion:
    """Moves to the start of one of the lines, preferably the first."""
    result = robot.plan(np.stack([line.poses[0] for line in lines]), collision, config.plan)
    if result.path is None:
        return result.failure
    return (yield from follow(robot, result.path, config.reach_share))


def _grasp(robot: Robot, number: int, config: DrawerConfig) -> Motion:
    """Grasps the handle; an object grasped instead is released."""
    robot.doing, robot.gripper = "grasp", GRASP
    for _ in range(config.grasp_steps):
        yield robot.command()
        if robot.scene.articulation(number).held:
            return None
    robot.gripper = RELEASE
    yield robot.command()
    robot.scene.missed()
    return Failure.EXECUTION


def travel_m(articulation: ArticulationState, out: bool, config: DrawerConfig) -> float:
    """Returns the remaining travel of a drawer along its axis [m]."""
    lower, upper = articulation.limits
    share = config.open_share if out else 1.0 - config.open_share
    return lower + share * (upper - lower) - articulation.joint


def _is_done(articulation: ArticulationState, out: bool, spare_m: float = 0.0) -> bool:
    """Whether a drawer counts as open, or closed, with a margin of `spare_m`."""
    lower, upper = articulation.limits
    joint = np.array(articulation.joint + (-spare_m if out else spare_m))
    share = (joint - lower) / (upper - lower)
    return bool(DRAWER.is_open(joint, share) if out else DRAWER.is_closed(joint))
