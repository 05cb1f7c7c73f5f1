"""The drawer skills as sense, plan and act: take the handle, follow its line, let go, rest."""

from __future__ import annotations

import time
from collections.abc import Generator
from dataclasses import dataclass, field, replace

import numpy as np

from hab_spa.motion.moves import follow, wait
from hab_spa.motion.rest import rest
from hab_spa.motion.robot import GRASP, RELEASE, Command, Motion, Robot
from hab_spa.planning.arm_plan import Ends, plan_path
from hab_spa.planning.collision import ArmCollision
from hab_spa.planning.path import TimingConfig, time_path
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
        near_m: The handle is not taken anew for so little.
        line: Numbers of grasps and lines.
        timing: Limits of speed along a line, and then beside the drawer.
        reach_share: Share of the time left that the way to the handle may take, ...
        line_share: ... and then that along the line, if the limits of speed allow.
        plan_checks: The plan to the handle is given up after so many collision checks.
        grasp_steps: The handle must be held after this many steps.
        still_steps: The hand keeps the handle this long at the end, until nothing moves.
        swing_m: What remains of the way up to this is left to a swing ...
        swing_poses: ... along so many poses at the end of the line ...
        swing_pace: ... at this multiple of the usual speed.
        lag_steps: The arm is so many steps behind its targets.
        swing_steps: The drawer is there after so many steps.
        judging: Numbers of the coarse lines by which a base pose is judged.
        far_m: Distances of base poses from the handle, best first ...
        aside_m: ... and how far to the side.
    """

    rounds: int = 3
    open_share: float = 0.985
    near_m: float = 0.035
    line: LineConfig = field(default_factory=LineConfig)
    timing: TimingConfig = field(default_factory=lambda: TimingConfig(paces=(0.5, 0.7, 1.0, 1.3)))
    reach_share: float = 0.3
    line_share: float = 0.4
    plan_checks: int = 40_000
    grasp_steps: int = 5
    still_steps: int = 5
    swing_m: float = 0.12
    swing_poses: int = 6
    swing_pace: float = 0.5
    lag_steps: int = 3
    swing_steps: int = 6
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
        if abs(_way_m(scene.front(number), out, config)) <= config.near_m:
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
    missing_m = abs(_way_m(scene.front(number), out, config))
    if failure is None and config.near_m < missing_m <= config.swing_m:
        yield from _swing(robot, line.poses[-config.swing_poses :], config)
        return None
    robot.relax()
    yield from wait(robot, config.still_steps)  # nothing brakes a drawer that is let go
    robot.doing, robot.gripper = "let go", RELEASE
    yield from wait(robot, robot.config.release_steps)
    return failure


def _reach(
    robot: Robot, collision: ArmCollision, lines: list[Line], config: DrawerConfig
) -> Motion:
    """Goes to where one of the lines begins, the first where possible."""
    start = robot.scene.arm_qpos.copy()
    ends = [Ends(open=start, tight=line.poses[0]) for line in lines]
    plan = replace(robot.config.plan, most_checks=config.plan_checks)
    result = plan_path(collision, robot.kinematics, ends, robot.next_seed(), plan)
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


def _swing(robot: Robot, end: Array, config: DrawerConfig) -> Generator[Command, None, None]:
    """Takes a drawer back along the end of its line (K, 7) and lets go of it on the way on.

    Next to nothing brakes it, so it goes where the arm does not get.
    """
    robot.doing = "swing"
    for path, lets_go in ((end[::-1], False), (end, True)):
        targets = time_path(path, robot.config.timing, config.swing_pace)
        for step, target in enumerate(targets):
            if lets_go and step >= len(targets) / 2 + config.lag_steps:
                robot.gripper = RELEASE
            yield robot.command(target)
        yield from wait(robot, config.lag_steps)
    yield from wait(robot, config.swing_steps)


def _way_m(front: FrontState, out: bool, config: DrawerConfig) -> float:
    """Returns how far a drawer is to move along its axis."""
    lower, upper = front.limits
    share = config.open_share if out else 1.0 - config.open_share
    return lower + share * (upper - lower) - front.joint


def _is_done(front: FrontState, out: bool) -> bool:
    """Whether a drawer counts as open, or closed."""
    lower, upper = front.limits
    joint, share = np.array(front.joint), np.array((front.joint - lower) / (upper - lower))
    return bool(DRAWER.is_open(joint, share) if out else DRAWER.is_closed(joint))
