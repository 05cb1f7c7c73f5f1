"""The drawer skills as sense, plan and act: take the handle, follow its line, let go, rest."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from hab_spa.motion.moves import follow, wait
from hab_spa.motion.rest import rest
from hab_spa.motion.robot import GRASP, RELEASE, Motion, Robot
from hab_spa.planning.arm_plan import Ends, PlanConfig, plan_path
from hab_spa.planning.collision import ArmCollision
from hab_spa.planning.path import TimingConfig
from hab_spa.results import Failure
from hab_spa.shapes import Array
from hab_spa.skills.drawer_lines import HandleLines, Line, LineConfig
from hab_tasks.fronts import DRAWER
from hab_tasks.navigation import NavigationMap
from hab_tasks.privileged import FrontState

ALL_WAYS = 12
"""What `drawer_ways` says of a base pose from which many grasps move the drawer all the way."""

JUDGING = LineConfig(
    starts=200, rounds=1, step_m=0.06, jump_rad=1.0, lines=ALL_WAYS // 2, apart_rad=0.0
)


@dataclass(frozen=True, kw_only=True)
class DrawerConfig:
    """The numbers of the drawer skills.

    Attributes:
        rounds: How often the handle is taken, where the arm does not get it all the way at once.
        open_share: Share of its travel to which a drawer is pulled; pushed, it is left as near
            to closed.
        spare_m: The handle is not taken anew when it is so far beyond what is asked for.
        line: Numbers of grasps and lines.
        timing: Limits of speed along a line, and then beside the drawer.
        reach_share: Share of the time left that the way to the handle may take, ...
        line_share: ... and then that along the line, if the limits of speed allow.
        plan: Numbers of the motion planner: short motions are worth some more computing.
        grasp_steps: The handle must be held after this many steps.
        still_steps: The hand keeps the handle this long at the end, until nothing moves.
        judging: Numbers of the coarse lines by which a base pose is judged.
        far_m: Distances of base poses from the handle, best first ...
        aside_m: ... and how far to the side.
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
    judging: LineConfig = field(default_factory=lambda: JUDGING)
    far_m: tuple[float, ...] = (0.65, 0.72, 0.58, 0.8)
    aside_m: tuple[float, ...] = (0.0, 0.15, -0.15, 0.3, -0.3)


def open_drawer(robot: Robot, number: int, config: DrawerConfig | None = None) -> Motion:
    """Takes the handle, pulls the drawer out, lets go and rests.

    Args:
        robot: Who does it.
        number: Number of the drawer among the doors and drawers of the episode.
        config: The numbers.
    """
    return (yield from _slide(robot, number, True, config or DrawerConfig()))


def close_drawer(robot: Robot, number: int, config: DrawerConfig | None = None) -> Motion:
    """Takes the handle, pushes the drawer in, lets go and rests; see `open_drawer`."""
    return (yield from _slide(robot, number, False, config or DrawerConfig()))


def drawer_ways(
    robot: Robot, number: int, base: Array, out: bool, config: DrawerConfig | None = None
) -> int:
    """Returns how well a drawer can be moved from a base pose (3,): 0 to `ALL_WAYS`.

    Up to half of that for a part of the way, more with the number of grasps for all of it.

    Args:
        robot: Who would do it.
        number: Number of the drawer.
        base: Where the robot is thought to stand.
        out: Whether the drawer is to be opened.
        config: The numbers.
    """
    config, front = config or DrawerConfig(), robot.scene.front(number)
    way_m = _way_m(front, out, config)
    lines = HandleLines(robot, front, way_m, config.judging, base).find(seed=0)
    whole = sum(found.missing_m <= config.judging.slack_m for found in lines)
    if whole or not lines:
        return whole + (ALL_WAYS // 2 if whole else 0)
    share = 1.0 - min(found.missing_m for found in lines) / abs(way_m)
    return int(share * ALL_WAYS / 2)


def drawer_places(
    robot: Robot, number: int, map_: NavigationMap, config: DrawerConfig | None = None
) -> Array:
    """Returns free base poses (K, 3) in a rectangle before a drawer, facing its handle.

    Args:
        robot: Who would stand there.
        number: Number of the drawer.
        map_: The floor.
        config: The numbers.
    """
    config, front = config or DrawerConfig(), robot.scene.front(number)
    ahead = front.axis[:2] / np.linalg.norm(front.axis[:2])
    aside = np.array((-ahead[1], ahead[0]))
    poses = []
    for far_m in config.far_m:
        for aside_m in config.aside_m:
            spot = front.handle_m[:2] + far_m * ahead + aside_m * aside
            gap = front.handle_m[:2] - spot
            if map_.is_free(spot):
                poses.append((*spot, np.arctan2(gap[1], gap[0])))
    return np.array(poses).reshape(-1, 3)


def _slide(robot: Robot, number: int, out: bool, config: DrawerConfig) -> Motion:
    """Moves a drawer, and takes it anew where the arm did not get it all the way."""
    scene, failure, began = robot.scene, None, robot.steps
    for _ in range(config.rounds):
        if _is_done(scene.front(number), out, config.spare_m):
            break
        failure = yield from _move(robot, number, out, config)
        if failure is Failure.TARGET_PLAN:
            break
    if failure is not None and robot.steps == began:
        return failure
    # A finger that cuts a corner is enough to push the drawer all the way.
    rested = yield from rest(robot, timing=config.timing)
    if rested is not None:  # beside an open drawer there may be no way that keeps clear of it
        rested = yield from rest(robot, without=scene.front(number).body, timing=config.timing)
    return rested if _is_done(scene.front(number), out) else failure or Failure.EXECUTION


def _move(robot: Robot, number: int, out: bool, config: DrawerConfig) -> Motion:
    """Goes to the handle, takes it along a line, and lets go."""
    scene, front = robot.scene, robot.scene.front(number)
    robot.doing, robot.gripper = "reach", RELEASE
    if scene.holding:
        return Failure.TARGET_PLAN
    began = time.perf_counter()
    hand = HandleLines(robot, front, _way_m(front, out, config), config.line)
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
    held = lambda: scene.front(number).held  # noqa: E731
    failure = yield from follow(robot, line.poses, config.line_share, held, config.timing)
    robot.relax()
    yield from wait(robot, config.still_steps)
    robot.doing, robot.gripper = "let go", RELEASE
    yield from wait(robot, robot.config.release_steps)
    return failure


def _reach(
    robot: Robot, collision: ArmCollision, lines: list[Line], config: DrawerConfig
) -> Motion:
    """Goes to where one of the lines begins, the first where possible."""
    start = robot.scene.arm_qpos.copy()
    ends = [Ends(open=start, tight=line.poses[0]) for line in lines]
    result = plan_path(collision, robot.kinematics, ends, robot.next_seed(), config.plan)
    robot.spend("motion", result.seconds)
    if result.path is None:
        return result.failure
    return (yield from follow(robot, result.path, config.reach_share))


def _grasp(robot: Robot, number: int, config: DrawerConfig) -> Motion:
    """Takes the handle; an object that is nearer to the hand is let go again."""
    robot.doing, robot.gripper = "grasp", GRASP
    for _ in range(config.grasp_steps):
        yield robot.command()
        if robot.scene.front(number).held:
            return None
    robot.gripper = RELEASE
    yield robot.command()
    return Failure.EXECUTION


def _way_m(front: FrontState, out: bool, config: DrawerConfig) -> float:
    """Returns how far a drawer is to move along its axis."""
    lower, upper = front.limits
    share = config.open_share if out else 1.0 - config.open_share
    return lower + share * (upper - lower) - front.joint


def _is_done(front: FrontState, out: bool, spare_m: float = 0.0) -> bool:
    """Whether a drawer counts as open, or closed, with so much to spare."""
    lower, upper = front.limits
    joint = np.array(front.joint + (-spare_m if out else spare_m))
    share = (joint - lower) / (upper - lower)
    return bool(DRAWER.is_open(joint, share) if out else DRAWER.is_closed(joint))
