"""Base maneuvers in front of the fridge: turn, drive straight forward or backward, turn."""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np
from hab_plans.motion import Command

from hab_spa.motion.drive import Wheels, WheelsConfig, angle
from hab_spa.motion.robot import Robot
from hab_spa.shapes import Array
from hab_tasks.robots.spec import RobotSpec

AHEAD_POSES = 6
"""Poses of a maneuver that are checked ahead of the robot, which needs two of them to stop."""


@dataclass(frozen=True, kw_only=True)
class ManeuverConfig(WheelsConfig):
    """Parameters of base maneuvers.

    Attributes:
        brake_steps: Steps of deceleration before a stop.
        near_m, near_rad: Tolerances at the end of each segment.
        blend_rad: The straight segment begins at this heading error, while the base still turns;
            it ends about 1 cm beside the line.
        turn_gain: Share of the heading error corrected per step on the straight segment.
    """

    ease: float = 0.34
    brake_steps: float = 2.0
    near_m: float = 0.02
    near_rad: float = 0.03
    blend_rad: float = 0.2
    turn_gain: float = 0.4
    still_rad: float = 0.003


@dataclass(frozen=True, kw_only=True)
class BaseManeuver:
    """A maneuver: turn to a heading, drive straight (backward if negative), turn to a final yaw.

    The headings are not wrapped: the signs of their differences are the directions of the turns.
    """

    robot: RobotSpec
    start: tuple[float, float, float]
    heading_rad: float
    length_m: float
    yaw_rad: float

    @property
    def steps(self) -> float:
        """Approximate duration [steps]."""
        turns = abs(self.heading_rad - self.start[2]) + abs(self.yaw_rad - self.heading_rad)
        stops = 6.0 * (abs(self.length_m) > 0) + 6.0 * (turns > 0)
        spec = self.robot
        return turns / spec.base_step_rad + abs(self.length_m) / spec.base_step_m + stops

    def poses(self, step_m: float = 0.08, step_rad: float = 0.2) -> Array:
        """Returns base poses (K, 3) along the maneuver, including its end."""
        x, y, yaw = self.start
        end = np.array((x, y)) + self.length_m * np.array(
            (math.cos(self.heading_rad), math.sin(self.heading_rad))
        )
        first = _turning((x, y), yaw, self.heading_rad, step_rad)
        count = 1 + math.ceil(abs(self.length_m) / step_m)
        line = np.linspace((x, y), end, count)
        straight = np.column_stack((line, np.full(count, self.heading_rad)))
        last = _turning((float(end[0]), float(end[1])), self.heading_rad, self.yaw_rad, step_rad)
        return np.concatenate((first, straight, last))


def _turning(point_m: tuple[float, float], start: float, end: float, step_rad: float) -> Array:
    count = 1 + math.ceil(abs(end - start) / step_rad)
    return np.column_stack((np.tile(point_m, (count, 1)), np.linspace(start, end, count)))


def base_maneuvers(robot: RobotSpec, base: Array, goal: Array) -> list[BaseManeuver]:
    """Returns the maneuvers of a robot from one base pose (3,) to another, fastest first.

    Each turn can go in either direction, and the straight segment forward or backward.
    """
    x, y, yaw = (float(value) for value in base)
    gap = goal[:2] - base[:2]
    length_m = float(np.linalg.norm(gap))
    make = partial(BaseManeuver, robot=robot, start=(x, y, yaw))
    if length_m < 0.03:
        turns = (_either(angle(goal[2], yaw), other) for other in (False, True))
        found = [make(heading_rad=yaw, length_m=0.0, yaw_rad=yaw + turn) for turn in turns]
        return sorted(found, key=lambda maneuver: maneuver.steps)
    found = []
    for sign, first, last in product((1.0, -1.0), (False, True), (False, True)):
        to = math.atan2(sign * gap[1], sign * gap[0])
        heading = yaw + _either(angle(to, yaw), first)
        end = heading + _either(angle(goal[2], heading), last)
        found.append(make(heading_rad=heading, length_m=sign * length_m, yaw_rad=end))
    return sorted(found, key=lambda maneuver: maneuver.steps)


def _either(turn_rad: float, other: bool) -> float:
    """Returns a turn, or its complement in the other direction."""
    return turn_rad - math.copysign(2 * math.pi, turn_rad) if other else turn_rad


def drive(
    robot: Robot, maneuver: BaseManeuver, config: ManeuverConfig
) -> Generator[Command, None, bool]:
    """Executes a maneuver; returns whether the base completed it, with nothing new in its way."""
    wheels = Wheels(robot, config)
    first_rad = maneuver.heading_rad - maneuver.start[2]
    near_rad = config.blend_rad if maneuver.length_m else config.near_rad
    through = yield from _turn(wheels, maneuver, first_rad, maneuver.heading_rad, near_rad)
    if through and maneuver.length_m:
        through = yield from _straight(wheels, maneuver)
    if through:
        last_rad = maneuver.yaw_rad - maneuver.heading_rad
        through = yield from _turn(wheels, maneuver, last_rad, maneuver.yaw_rad, config.near_rad)
    yield from wheels.stop()
    return through


def _blocked(robot: Robot, maneuver: BaseManeuver) -> bool:
    """Whether something new is in the way of the next base poses of a maneuver."""
    poses, base = maneuver.poses(), robot.base
    gaps = np.linalg.norm(poses[:, :2] - base[:2], axis=1)
    gaps += np.abs(np.angle(np.exp(1j * (poses[:, 2] - base[2]))))
    # A full turn passes a pose twice; the later one is not yet next.
    here = int(gaps.argmin())
    return robot.scene.drives_into(poses[here : here + AHEAD_POSES])


def _turn(
    wheels: Wheels[ManeuverConfig],
    maneuver: BaseManeuver,
    turn_rad: float,
    yaw_rad: float,
    near_rad: float,
) -> Generator[Command, None, bool]:
    """Turns by about `turn_rad` until near a heading; beyond pi, a turn keeps its direction."""
    config, robot = wheels.config, wheels.robot
    left, before = turn_rad, robot.base[2]
    while abs(left) > near_rad:
        if wheels.stuck or _blocked(robot, maneuver):
            return False
        yield wheels.roll(0.0, left / (config.brake_steps * robot.spec.base_step_rad))
        left -= angle(robot.base[2], before)
        before = robot.base[2]
        if abs(left) < math.pi / 2:
            left = angle(yaw_rad, before)
    return True


def _straight(
    wheels: Wheels[ManeuverConfig], maneuver: BaseManeuver
) -> Generator[Command, None, bool]:
    """Drives the straight segment."""
    config, robot = wheels.config, wheels.robot
    ahead = np.array((math.cos(maneuver.heading_rad), math.sin(maneuver.heading_rad)))
    start = np.array(maneuver.start[:2])
    while True:
        left = maneuver.length_m - float((robot.base[:2] - start) @ ahead)
        if abs(left) < config.near_m or left * maneuver.length_m < 0:
            break
        if wheels.stuck or _blocked(robot, maneuver):
            return False
        turn = angle(maneuver.heading_rad, robot.base[2])
        forward = left / (config.brake_steps * robot.spec.base_step_m)
        yield wheels.roll(forward, config.turn_gain * turn / robot.spec.base_step_rad)
    yield from wheels.stop()
    return True
