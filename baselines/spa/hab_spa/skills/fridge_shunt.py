"""Short drives before the fridge: a turn, a straight way forwards or back, and a turn."""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass
from itertools import product

import numpy as np

from hab_spa.motion.drive import STEP_M, STEP_RAD, angle
from hab_spa.motion.robot import Command, Robot
from hab_spa.shapes import Array


@dataclass(frozen=True, kw_only=True)
class ShuntConfig:
    """How the base is shunted.

    Attributes:
        turn_share, way_share: Largest velocities, as shares of what the base can do.
        ease: Largest change of a share in one step.
        brake_steps: The base slows down so many steps before it stops.
        near_m, near_rad: A part of the drive is over within these.
        turn_gain: Share of the heading error that a step takes away on the straight way.
        still_steps: It is given up when the base has not moved in so many steps.
    """

    turn_share: float = 1.0
    way_share: float = 1.0
    ease: float = 0.34
    brake_steps: float = 4.0
    near_m: float = 0.02
    near_rad: float = 0.03
    turn_gain: float = 0.4
    still_steps: int = 8


@dataclass(frozen=True, kw_only=True)
class Shunt:
    """A drive: turn to a heading, go a way (backwards if negative), turn to the last heading.

    The headings are not wrapped: their differences tell which way round the base turns.
    """

    start: tuple[float, float, float]
    heading_rad: float
    way_m: float
    yaw_rad: float

    @property
    def steps(self) -> float:
        """About how many steps it takes."""
        turns = abs(self.heading_rad - self.start[2]) + abs(self.yaw_rad - self.heading_rad)
        stops = 6.0 * (abs(self.way_m) > 0) + 6.0 * (turns > 0)
        return turns / STEP_RAD + abs(self.way_m) / STEP_M + stops

    def poses(self, step_m: float = 0.08, step_rad: float = 0.2) -> Array:
        """Returns base poses (K, 3) along it, its end included."""
        x, y, yaw = self.start
        end = np.array((x, y)) + self.way_m * np.array(
            (math.cos(self.heading_rad), math.sin(self.heading_rad))
        )
        first = _turning((x, y), yaw, self.heading_rad, step_rad)
        count = 1 + math.ceil(abs(self.way_m) / step_m)
        line = np.linspace((x, y), end, count)
        straight = np.column_stack((line, np.full(count, self.heading_rad)))
        last = _turning((float(end[0]), float(end[1])), self.heading_rad, self.yaw_rad, step_rad)
        return np.concatenate((first, straight, last))


def _turning(point_m: tuple[float, float], start: float, end: float, step_rad: float) -> Array:
    count = 1 + math.ceil(abs(end - start) / step_rad)
    return np.column_stack((np.tile(point_m, (count, 1)), np.linspace(start, end, count)))


def shunts(base: Array, goal: Array) -> list[Shunt]:
    """Returns the ways of shunting from one base pose (3,) to another, the quickest first.

    Each turn may go either way round, and the straight way forwards or backwards.
    """
    x, y, yaw = (float(value) for value in base)
    gap = goal[:2] - base[:2]
    way_m = float(np.linalg.norm(gap))
    if way_m < 0.03:
        turns = (_either(angle(goal[2], yaw), other) for other in (False, True))
        found = [
            Shunt(start=(x, y, yaw), heading_rad=yaw, way_m=0.0, yaw_rad=yaw + turn)
            for turn in turns
        ]
        return sorted(found, key=lambda shunt: shunt.steps)
    found = []
    for sign, first, last in product((1.0, -1.0), (False, True), (False, True)):
        to = math.atan2(sign * gap[1], sign * gap[0])
        heading = yaw + _either(angle(to, yaw), first)
        end = heading + _either(angle(goal[2], heading), last)
        found.append(Shunt(start=(x, y, yaw), heading_rad=heading, way_m=sign * way_m, yaw_rad=end))
    return sorted(found, key=lambda shunt: shunt.steps)


def _either(turn_rad: float, other: bool) -> float:
    """Returns a turn, or the one the other way round."""
    return turn_rad - math.copysign(2 * math.pi, turn_rad) if other else turn_rad


def drive(robot: Robot, shunt: Shunt, config: ShuntConfig) -> Generator[Command, None, bool]:
    """Drives as planned; whether the base got through."""
    wheels = _Wheels(robot, config)
    through = yield from _turn(wheels, shunt.heading_rad - shunt.start[2], shunt.heading_rad)
    if through and shunt.way_m:
        through = yield from _straight(wheels, shunt)
    if through:
        through = yield from _turn(wheels, shunt.yaw_rad - shunt.heading_rad, shunt.yaw_rad)
    yield from wheels.stop()
    return through


class _Wheels:
    """Eases the base's velocities, and counts how long it has not moved."""

    def __init__(self, robot: Robot, config: ShuntConfig) -> None:
        self.robot, self.config, self.still = robot, config, 0
        self._share, self._last = np.zeros(2), robot.base

    def roll(self, forward: float, turn: float) -> Command:
        config, base = self.config, self.robot.base
        most = np.array((config.way_share, config.turn_share))
        wanted = np.clip((forward, turn), -most, most)
        self._share += np.clip(wanted - self._share, -config.ease, config.ease)
        moved = np.linalg.norm(base[:2] - self._last[:2]) + abs(angle(base[2], self._last[2]))
        self.still = 0 if moved > 0.003 else self.still + 1
        self._last = base
        return self.robot.command(base=(float(self._share[0]), float(self._share[1])))

    @property
    def stuck(self) -> bool:
        return self.still >= self.config.still_steps or self.robot.steps_left <= 0

    def stop(self) -> Generator[Command, None, None]:
        while np.abs(self._share).max() > 0:
            yield self.roll(0.0, 0.0)


def _turn(wheels: _Wheels, turn_rad: float, yaw_rad: float) -> Generator[Command, None, bool]:
    """Turns by about `turn_rad`, to a heading; a turn of more than pi keeps its direction."""
    config, robot = wheels.config, wheels.robot
    left, before = turn_rad, robot.base[2]
    while abs(left) > config.near_rad:
        if wheels.stuck:
            return False
        yield wheels.roll(0.0, left / (config.brake_steps * STEP_RAD))
        left -= angle(robot.base[2], before)
        before = robot.base[2]
        if abs(left) < math.pi / 2:
            left = angle(yaw_rad, before)
    yield from wheels.stop()
    return True


def _straight(wheels: _Wheels, shunt: Shunt) -> Generator[Command, None, bool]:
    """Goes straight on until the way is covered."""
    config, robot = wheels.config, wheels.robot
    ahead = np.array((math.cos(shunt.heading_rad), math.sin(shunt.heading_rad)))
    start = np.array(shunt.start[:2])
    while True:
        left = shunt.way_m - float((robot.base[:2] - start) @ ahead)
        if abs(left) < config.near_m or left * shunt.way_m < 0:
            break
        if wheels.stuck:
            return False
        turn = angle(shunt.heading_rad, robot.base[2])
        yield wheels.roll(left / (config.brake_steps * STEP_M), config.turn_gain * turn / STEP_RAD)
    yield from wheels.stop()
    return True
