"""Driving along shortest paths on the floor map, with limited accelerations."""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np
from hab_plans.motion import Command, Failure, Motion

from hab_spa.motion.robot import Robot
from hab_spa.shapes import Array
from hab_tasks.world.navigation import NavigationMap, path_between


@dataclass(frozen=True, kw_only=True)
class WheelsConfig:
    """Limits of the velocities, and thresholds of a stuck base.

    Attributes:
        way_share, turn_share: Maximum velocities, relative to the base's.
        ease: Maximum change of a relative velocity per step.
        still_m, still_rad, still_steps: The base is stuck when it has moved less than these
            thresholds in each of these steps.
    """

    way_share: float = 1.0
    turn_share: float = 1.0
    ease: float = 0.25
    still_m: float = 0.003
    still_rad: float = 0.01
    still_steps: int = 8


Config = TypeVar("Config", bound=WheelsConfig)


class Wheels(Generic[Config]):
    """Limits accelerations and detects a stuck base."""

    def __init__(self, robot: Robot, config: Config) -> None:
        self.robot, self.config = robot, config
        self._share, self._still, self._last = np.zeros(2), 0, robot.base

    @property
    def stuck(self) -> bool:
        """Whether the base is stuck, or no steps are left."""
        return self._still >= self.config.still_steps or self.robot.steps_left <= 0

    def free(self) -> None:
        """Resets the detection of a stuck base."""
        self._still = 0

    def roll(self, forward: float, turn: float) -> Command:
        """Returns the command nearest to these relative velocities, within the limits."""
        config, base = self.config, self.robot.base
        most = np.array((config.way_share, config.turn_share))
        wanted = np.clip((forward, turn), -most, most)
        self._share += np.clip(wanted - self._share, -config.ease, config.ease)
        distance_m = float(np.linalg.norm(base[:2] - self._last[:2]))
        moves = distance_m > config.still_m or abs(angle(base[2], self._last[2])) > config.still_rad
        self._still = 0 if moves else self._still + 1
        self._last = base
        return self.robot.command(base=(float(self._share[0]), float(self._share[1])))

    def stop(self) -> Generator[Command, None, None]:
        """Decelerates to a stop."""
        while np.abs(self._share).max() > 0:
            yield self.roll(0.0, 0.0)


def angle(to_rad: float, from_rad: float) -> float:
    """Returns the smallest turn [rad] from one heading to another."""
    return float((to_rad - from_rad + math.pi) % (2 * math.pi) - math.pi)


FARTHER = (1.0, 0.7, 1.5, 2.0)
ASIDE_RAD = np.deg2rad((0.0, 20.0, -20.0, 40.0, -40.0, 60.0, -60.0))
"""Distances of turning points from the goal, relative to `before_m`, and their bearings."""


@dataclass(frozen=True, kw_only=True)
class DriveConfig(WheelsConfig):
    """Parameters of driving.

    Attributes:
        arrived_m, arrived_rad: Tolerances of the goal.
        waypoint_m: Tolerance of a waypoint.
        turn_first_rad: The base turns in place while its heading error exceeds this, and slows
            down from half of it.
        turn_gain: Share of the heading error corrected per step.
        turn_share: Maximum turning speed, relative to the base's; below 1, since the grasp holds
            an object better in slow turns.
        brake_steps: Steps of deceleration before a stop.
        before_m: The base turns at this distance behind the goal, where the arm has room, and
            drives the rest straight; it leaves a base pose the same way.
        turning_m: Clearance in which the base turns without meeting a wall with the hand. Where the
            floor behind the goal has less, the base comes from aside if it has more there. 0 for an
            arm that is folded.
        back_steps: Steps of backing off when the base is stuck, before it replans.
    """

    arrived_m: float = 0.04
    arrived_rad: float = 0.05
    waypoint_m: float = 0.1
    turn_first_rad: float = 0.3
    turn_gain: float = 0.5
    turn_share: float = 0.6
    brake_steps: float = 5.0
    before_m: float = 0.35
    turning_m: float = 0.0
    back_steps: int = 8


def drive_to(robot: Robot, map_: NavigationMap, goal: Array, config: DriveConfig) -> Motion:
    """Drives to a base pose (3,) on the free floor of a map.

    Returns:
        `Failure.EXECUTION` if the goal is not reached by the robot's deadline.
    """
    # Straight back first: a turn in front of furniture would sweep the arm along it.
    yield from leave(robot, map_, config)
    wheels = Wheels(robot, config)
    before = _before(map_, goal, config)
    while robot.steps_left > 0:
        here = robot.base[:2]
        last = goal if before is None else before
        # No detour by the turning point where the goal is straight ahead already.
        if before is not None and map_.clear(here, goal[:2]) and _behind(here, goal):
            last = goal
        arrived = yield from _along(wheels, path_between(map_, here, last[:2])[1:])
        arrived = arrived and (yield from _turn(wheels, last[2]))
        # Also where `last` is the goal, as the turn may have displaced the base.
        arrived = arrived and (yield from _along(wheels, goal[None, :2]))
        arrived = arrived and (yield from _turn(wheels, goal[2]))
        if arrived and _at(robot, goal, config):
            # Standing still is Navigate's stop action, and the base may have stood there before.
            yield robot.command()
            return None
        yield from _back_off(wheels)
    return Failure.EXECUTION


def _at(robot: Robot, goal: Array, config: DriveConfig) -> bool:
    gap_m = float(np.linalg.norm(goal[:2] - robot.base[:2]))
    # The final turn may displace the base slightly.
    return gap_m < 2 * config.arrived_m and abs(angle(goal[2], robot.base[2])) < 2 * (
        config.arrived_rad
    )


def _along(wheels: Wheels[DriveConfig], points_m: Array) -> Generator[Command, None, bool]:
    """Drives through waypoints (P, 2) and stops at the last; returns whether it was reached."""
    robot, config = wheels.robot, wheels.config
    step_m = robot.spec.base_step_m
    # To have stood since the last stretch is not to be stuck.
    wheels.free()
    for number, point in enumerate(points_m):
        last = number == len(points_m) - 1
        near_m = config.arrived_m if last else config.waypoint_m
        while True:
            gap = point - robot.base[:2]
            gap_m = float(np.linalg.norm(gap))
            if gap_m < near_m:
                break
            if wheels.stuck:
                return False
            turn = angle(math.atan2(gap[1], gap[0]), robot.base[2])
            # A final point just missed is behind the base: back up instead of turning round.
            sign = -1.0 if last and gap_m < config.before_m and abs(turn) > math.pi / 2 else 1.0
            if sign < 0:
                turn = angle(turn + math.pi, 0.0)
            forward = 0.0
            if abs(turn) < config.turn_first_rad:
                forward = sign * (gap_m / (config.brake_steps * step_m) if last else 1.0)
                forward *= min(1.0, 2.0 * (1.0 - abs(turn) / config.turn_first_rad))
            yield wheels.roll(forward, config.turn_gain * turn / robot.spec.base_step_rad)
    yield from wheels.stop()
    return True


def _turn(wheels: Wheels[DriveConfig], yaw_rad: float) -> Generator[Command, None, bool]:
    """Turns in place; returns whether the heading was reached."""
    robot, config = wheels.robot, wheels.config
    wheels.free()
    while abs(turn := angle(yaw_rad, robot.base[2])) > config.arrived_rad:
        if wheels.stuck:
            return False
        yield wheels.roll(0.0, config.turn_gain * turn / robot.spec.base_step_rad)
    yield from wheels.stop()
    return True


def turn_to(robot: Robot, yaw_rad: float) -> Generator[Command, None, None]:
    """Turns the base on the spot to a heading."""
    wheels = Wheels(robot, DriveConfig())
    yield from _turn(wheels, yaw_rad)
    yield from wheels.stop()


def leave(robot: Robot, map_: NavigationMap, config: DriveConfig) -> Generator[Command, None, None]:
    """Drives straight back from the current base pose, up to `before_m`, if there is room."""
    wheels = Wheels(robot, config)
    start = robot.base
    back = -np.array((math.cos(start[2]), math.sin(start[2])))
    lengths = np.linspace(config.before_m, 0.0, 8)
    room_m = next(
        (length for length in lengths if map_.is_free(start[:2] + length * back).all()
         and _comes_free(map_, start[:2], start[:2] + length * back)), 0.0
    )  # fmt: skip
    yield from _reverse(wheels, room_m - config.arrived_m)


def reverse(robot: Robot, distance_m: float, config: DriveConfig) -> Motion:
    """Drives straight back so far, or until something is in the way; needs no map."""
    yield from _reverse(Wheels(robot, config), distance_m)
    return None


def _reverse(wheels: Wheels[DriveConfig], distance_m: float) -> Generator[Command, None, None]:
    start_m = wheels.robot.base[:2]
    while np.linalg.norm(wheels.robot.base[:2] - start_m) < distance_m:
        if wheels.stuck:
            break
        yield wheels.roll(-0.6, 0.0)
    yield from wheels.stop()


def _comes_free(map_: NavigationMap, start_m: Array, end_m: Array) -> bool:
    """Whether a straight line, once it is on free floor, stays on free floor."""
    points = start_m + np.linspace(0.0, 1.0, 12)[:, None] * (end_m - start_m)
    free = map_.is_free(points)
    return bool((np.diff(free.astype(int)) >= 0).all())


def _back_off(wheels: Wheels[DriveConfig]) -> Generator[Command, None, None]:
    """Drives back a little, away from the obstacle."""
    wheels.free()
    for _ in range(wheels.config.back_steps):
        yield wheels.roll(-0.5, 0.0)
    yield from wheels.stop()


def _before(map_: NavigationMap, goal: Array, config: DriveConfig) -> Array | None:
    """Returns the turning point behind a goal with the heading there, (3,); None if no room."""
    entry = map_.nearest_free(goal[:2])
    for aside_rad in ASIDE_RAD if config.turning_m > 0 else ASIDE_RAD[:1]:
        yaw_rad = goal[2] + aside_rad
        ahead = np.array((math.cos(yaw_rad), math.sin(yaw_rad)))
        for share in FARTHER if config.turning_m > 0 else FARTHER[:2]:
            point = goal[:2] - share * config.before_m * ahead
            if map_.clear(point, entry) and map_.clearance_m(point) >= config.turning_m:
                return np.append(point, yaw_rad)
    # Rather turn with too little room for the arm than not go there.
    return None if config.turning_m == 0 else _before(map_, goal, replace(config, turning_m=0.0))


def _behind(here: Array, goal: Array) -> bool:
    """Whether a goal is straight ahead of a position (2,), within 30 degrees of its heading."""
    gap = goal[:2] - here
    return abs(angle(math.atan2(gap[1], gap[0]), goal[2])) < math.pi / 6
