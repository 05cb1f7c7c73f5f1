"""Driving: along the shortest way over the free floor, by velocities of the real base."""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from hab_spa.motion.robot import Command, Motion, Robot
from hab_spa.results import Failure
from hab_spa.shapes import Array
from hab_tasks.constants import CONTROL_HZ
from hab_tasks.navigation import NavigationMap, path_between
from hab_tasks.robots.fetch_spec import BASE_ANGULAR_SPEED_RAD_S, BASE_LINEAR_SPEED_M_S

STEP_M = BASE_LINEAR_SPEED_M_S / CONTROL_HZ
STEP_RAD = BASE_ANGULAR_SPEED_RAD_S / CONTROL_HZ


@dataclass(frozen=True, kw_only=True)
class DriveConfig:
    """How the base is driven.

    Attributes:
        arrived_m, arrived_rad: The goal is reached within these.
        waypoint_m: A point of the way counts as passed within this distance.
        turn_first_rad: The base turns in place while it looks farther than this off its way, and
            slows down from half of it.
        turn_gain: Share of the heading error that a step takes away.
        turn_share: Largest turning velocity, as a share of what the base can do: the arm holds
            what it carries better when it is swung slowly.
        brake_steps: The base slows down so many steps before a point where it stops.
        ease: Largest change of a velocity's share in one step.
        before_m: Before a goal the base turns this far behind it, where the arm has room, and
            drives the rest straight ahead; it leaves a place the same way.
        still_m, still_rad, still_steps: The base is stuck when it has moved less than these in
            each of so many steps; it then backs off for `back_steps` and looks for the way anew.
    """

    arrived_m: float = 0.04
    arrived_rad: float = 0.05
    waypoint_m: float = 0.1
    turn_first_rad: float = 0.3
    turn_gain: float = 0.5
    turn_share: float = 0.6
    brake_steps: float = 5.0
    ease: float = 0.25
    before_m: float = 0.35
    still_m: float = 0.003
    still_rad: float = 0.01
    still_steps: int = 8
    back_steps: int = 8


def drive_to(robot: Robot, map_: NavigationMap, goal: Array, config: DriveConfig) -> Motion:
    """Drives to a base pose (3,) over the free floor of a map.

    Returns:
        `Failure.EXECUTION` when the goal was not reached by the robot's deadline.
    """
    yield from leave(robot, map_, config)
    wheels = _Wheels(robot, config)
    before = _before(map_, goal, config)
    while robot.steps_left > 0:
        here = robot.base[:2]
        last = goal[:2] if before is None else before
        if before is not None and map_.clear(here, goal[:2]) and _behind(here, goal):
            last = goal[:2]
        arrived = yield from _along(wheels, path_between(map_, here, last)[1:])
        arrived = arrived and (yield from _turn(wheels, goal[2]))
        if arrived and last is not goal[:2]:
            arrived = yield from _along(wheels, goal[None, :2])
            arrived = arrived and (yield from _turn(wheels, goal[2]))
        if arrived and _at(robot, goal, config):
            yield robot.command()
            return None
        yield from _back_off(wheels)
    return Failure.EXECUTION


def _at(robot: Robot, goal: Array, config: DriveConfig) -> bool:
    gap_m = float(np.linalg.norm(goal[:2] - robot.base[:2]))
    # The last turn may move the base a little.
    return gap_m < 2 * config.arrived_m and abs(angle(goal[2], robot.base[2])) < 2 * (
        config.arrived_rad
    )


class _Wheels:
    """Eases velocities, and notices that the base is stuck."""

    def __init__(self, robot: Robot, config: DriveConfig) -> None:
        self.robot, self.config = robot, config
        self._share, self._still, self._last = np.zeros(2), 0, robot.base

    @property
    def stuck(self) -> bool:
        return self._still >= self.config.still_steps

    def free(self) -> None:
        self._still = 0

    def roll(self, forward: float, turn: float) -> Command:
        config = self.config
        wanted = np.array(
            (np.clip(forward, -1.0, 1.0), np.clip(turn, -config.turn_share, config.turn_share))
        )
        self._share += np.clip(wanted - self._share, -config.ease, config.ease)
        base = self.robot.base
        way_m = float(np.linalg.norm(base[:2] - self._last[:2]))
        moves = way_m > config.still_m or abs(angle(base[2], self._last[2])) > config.still_rad
        self._still = 0 if moves else self._still + 1
        self._last = base
        return self.robot.command(base=(float(self._share[0]), float(self._share[1])))

    def stop(self) -> Generator[Command, None, None]:
        while np.abs(self._share).max() > 0:
            yield self.roll(0.0, 0.0)


def _along(wheels: _Wheels, points_m: Array) -> Generator[Command, None, bool]:
    """Drives through points (P, 2) and stops at the last one; whether it got there."""
    robot, config = wheels.robot, wheels.config
    wheels.free()
    for number, point in enumerate(points_m):
        last = number == len(points_m) - 1
        near_m = config.arrived_m if last else config.waypoint_m
        while True:
            gap = point - robot.base[:2]
            gap_m = float(np.linalg.norm(gap))
            if gap_m < near_m:
                break
            if wheels.stuck or robot.steps_left <= 0:
                return False
            turn = angle(math.atan2(gap[1], gap[0]), robot.base[2])
            # A point that was just missed lies behind; there is no sense in turning round for it.
            sign = -1.0 if last and gap_m < config.before_m and abs(turn) > math.pi / 2 else 1.0
            if sign < 0:
                turn = angle(turn + math.pi, 0.0)
            forward = 0.0
            if abs(turn) < config.turn_first_rad:
                forward = sign * (gap_m / (config.brake_steps * STEP_M) if last else 1.0)
                forward *= min(1.0, 2.0 * (1.0 - abs(turn) / config.turn_first_rad))
            yield wheels.roll(forward, config.turn_gain * turn / STEP_RAD)
    yield from wheels.stop()
    return True


def _turn(wheels: _Wheels, yaw_rad: float) -> Generator[Command, None, bool]:
    """Turns in place; whether it could."""
    robot, config = wheels.robot, wheels.config
    wheels.free()
    while abs(turn := angle(yaw_rad, robot.base[2])) > config.arrived_rad:
        if wheels.stuck or robot.steps_left <= 0:
            return False
        yield wheels.roll(0.0, config.turn_gain * turn / STEP_RAD)
    yield from wheels.stop()
    return True


def leave(robot: Robot, map_: NavigationMap, config: DriveConfig) -> Generator[Command, None, None]:
    """Drives straight back from what the robot stands at, as far as there is room."""
    wheels = _Wheels(robot, config)
    start = robot.base
    back = -np.array((math.cos(start[2]), math.sin(start[2])))
    lengths = np.linspace(config.before_m, 0.0, 8)
    room_m = next(
        (way for way in lengths if map_.is_free(start[:2] + way * back).all()
         and _comes_free(map_, start[:2], start[:2] + way * back)), 0.0
    )  # fmt: skip
    while np.linalg.norm(robot.base[:2] - start[:2]) < room_m - config.arrived_m:
        if wheels.stuck or robot.steps_left <= 0:
            break
        yield wheels.roll(-0.6, 0.0)
    yield from wheels.stop()


def _comes_free(map_: NavigationMap, start_m: Array, end_m: Array) -> bool:
    """Whether a straight way is free from where it first is, and gets there at once."""
    points = start_m + np.linspace(0.0, 1.0, 12)[:, None] * (end_m - start_m)
    free = map_.is_free(points)
    return bool((np.diff(free.astype(int)) >= 0).all())


def _back_off(wheels: _Wheels) -> Generator[Command, None, None]:
    """Drives back a little, with a turn: what was met lies ahead, or beside the arm."""
    wheels.free()
    for _ in range(wheels.config.back_steps):
        yield wheels.roll(-0.5, 0.0)
    yield from wheels.stop()


def _before(map_: NavigationMap, goal: Array, config: DriveConfig) -> Array | None:
    """Returns the point (2,) behind a goal where the base turns; None if there is no room."""
    ahead = np.array((math.cos(goal[2]), math.sin(goal[2])))
    for way_m in (config.before_m, 0.7 * config.before_m):
        point = goal[:2] - way_m * ahead
        if map_.clear(point, map_.nearest_free(goal[:2])):
            return point
    return None


def _behind(here: Array, goal: Array) -> bool:
    """Whether a goal lies straight ahead of a place, within 30 degrees."""
    gap = goal[:2] - here
    return abs(angle(math.atan2(gap[1], gap[0]), goal[2])) < math.pi / 6


def angle(to_rad: float, from_rad: float) -> float:
    """Returns the smallest turn [rad] from one heading to another."""
    return float((to_rad - from_rad + math.pi) % (2 * math.pi) - math.pi)
