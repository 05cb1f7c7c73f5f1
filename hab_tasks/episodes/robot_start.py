"""Start poses of the robot: facing an object, in a rectangle before furniture, or anywhere free.

A start is free of contact with clearance; where the arm has to reach something, some arm pose
brings the hand into grasping range without touching anything.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np

from hab_tasks.episodes.refusal import RefusedError
from hab_tasks.episodes.schema import Base, RobotStart
from hab_tasks.episodes.workbench import Workbench
from hab_tasks.geometry import Array, apply, planar
from hab_tasks.robots.fetch import BASE_HEIGHT_M
from hab_tasks.robots.fetch_spec import (
    ARM_LOWER_RAD,
    ARM_UPPER_RAD,
    EE_LOWER_M,
    EE_UPPER_M,
    REST_QPOS_RAD,
)
from hab_tasks.robots.kinematics import ArmKinematics

START_CLEARANCE_M = 0.015
"""Everything must be at least this far from the robot where an episode starts."""

START_DIGITS = 6

HAND_CLEARANCE_M = 0.25
"""The hand starts at least this far from what the skill is about. It snaps to all within 0.15 m;
random actions that start 0.2 m away still win 8 % of Place (4 of 50)."""

HAND_TOO_NEAR = f"the hand starts within {HAND_CLEARANCE_M} m of its target"
"""Counted for every place; the next one is tried."""


@dataclass(frozen=True, kw_only=True)
class StartNoise:
    """Noise of a start (S H.2), uniform within plus and minus its value, and where to look.

    Attributes:
        base_m: Of the base's x and y.
        heading_rad: Of the base's heading.
        ee_m: Of the end-effector's x, y and z.
        clearance_m: Free radius around the base.
        nearest_m: Nearest distance of the base to what it faces.
        farthest_m: Farthest one.
        candidates: How many places are tried.
        reach_tries: How many arm poses are tried to reach something.
        reach_radius_m: How near to it the hand must come.
    """

    base_m: float = 0.1
    heading_rad: float = math.radians(20.0)
    ee_m: float = 0.05
    clearance_m: float = 0.32
    nearest_m: float = 0.45
    farthest_m: float = 1.15
    candidates: int = 12
    reach_tries: int = 60
    reach_radius_m: float = 0.11


@dataclass(frozen=True, kw_only=True)
class Rectangle:
    """A region of the floor in a frame of furniture: x ahead of it, y to the side [m]."""

    x_m: tuple[float, float]
    y_m: tuple[float, float]

    def contains(self, x_m: float, y_m: float) -> bool:
        """Whether a point of the frame is inside."""
        return self.x_m[0] <= x_m <= self.x_m[1] and self.y_m[0] <= y_m <= self.y_m[1]


@dataclass(frozen=True, kw_only=True)
class KeepOff:
    """What the hand must not start at.

    Attributes:
        points_m: (K, 3) in the world.
        level: Whether only the horizontal distance counts.
        radius_m: How far the end-effector keeps from each of them.
    """

    points_m: Array
    level: bool = False
    radius_m: float = HAND_CLEARANCE_M

    def meets(self, hand_m: Array) -> bool:
        """Whether an end-effector at a point (3,) is too near to one of them."""
        axes = 2 if self.level else 3
        gaps_m = np.linalg.norm((self.points_m - hand_m)[:, :axes], axis=1)
        return bool((gaps_m < self.radius_m).any())


NOTHING_NEAR = KeepOff(points_m=np.empty((0, 3)))


class RobotStarts:
    """Finds start poses in a workbench's layout as it stands.

    Attributes:
        noise: Noise of a start.
        refused: Reason -> places that were refused although the robot could stand there.
    """

    def __init__(
        self,
        bench: Workbench,
        rng: np.random.Generator,
        kinematics: ArmKinematics,
        noise: StartNoise = StartNoise(),
        keep_off: KeepOff = NOTHING_NEAR,
    ) -> None:
        """Finds starts whose hand is off `keep_off`."""
        self._bench, self._rng, self._kinematics = bench, rng, kinematics
        self.noise, self._keep_off = noise, keep_off
        self.refused: Counter[str] = Counter()

    def facing(self, target_m: Array) -> RobotStart:
        """Stands on the nearest free floor from which a point (3,) can be reached.

        Raises:
            RefusedError: There is no such place.
        """
        noise = self.noise
        cells = self._bench.floor().cells_by_distance(target_m, noise.clearance_m, noise.nearest_m)
        near = cells[np.linalg.norm(cells - target_m[:2], axis=1) < noise.farthest_m]
        if not len(near):
            raise RefusedError("no free floor near the target")
        reason = "target out of reach"
        for cell in near[:: max(1, len(near) // noise.candidates)]:
            draw = self._rng.uniform(-1.0, 1.0, 6)
            base = self._noisy_base(cell, target_m, draw)
            arm = self._noisy_arm(draw[3:])
            if arm is None or self._bench.robot_touches(base, arm, START_CLEARANCE_M):
                reason = "robot too close to something at its start"
            elif self._hand_too_near(base, arm):
                reason = "no place has the hand off its target"
            elif self.reaches(base, target_m):
                return _start(base, arm)
        raise RefusedError(reason)

    def in_rectangle(
        self, world_from_frame: Array, region: Rectangle, facing_m: Array, reach: bool
    ) -> RobotStart:
        """Stands in a rectangle before furniture, facing a point (3,).

        Args:
            world_from_frame: (4, 4) the rectangle's frame; its x axis points into the room.
            region: The rectangle; the base stays in it, noise included.
            facing_m: What the robot looks at.
            reach: Whether the arm must reach that point from there.

        Raises:
            RefusedError: No free place in it.
        """
        reason = "no free floor in the spawn region"
        floor = self._bench.floor()
        for _ in range(self.noise.candidates):
            x = self._rng.uniform(*region.x_m)
            y = self._rng.uniform(*region.y_m)
            point = (world_from_frame @ np.array([x, y, 0.0, 1.0]))[:2]
            draw = self._rng.uniform(-1.0, 1.0, 4)
            if floor.clearance_at(point) < self.noise.clearance_m:
                continue
            base = self._turned(point, facing_m, draw[0])
            arm = self._noisy_arm(draw[1:])
            if arm is None or self._bench.robot_touches(base, arm, START_CLEARANCE_M):
                reason = "robot too close to something at its start"
            elif self._hand_too_near(base, arm):
                reason = "no place has the hand off its target"
            elif not reach or self.reaches(base, facing_m):
                return _start(base, arm)
            else:
                reason = "handle out of reach"
        raise RefusedError(reason)

    def anywhere(self, away_from_m: Array | None = None, distance_m: float = 0.0) -> RobotStart:
        """Stands anywhere on the free floor, turned anyhow, at least so far from a point (2,).

        Raises:
            RefusedError: No place was found.
        """
        floor = self._bench.floor()
        centre = np.zeros(2) if away_from_m is None else away_from_m
        cells = floor.cells_by_distance(centre, self.noise.clearance_m, distance_m)
        for _ in range(self.noise.candidates if len(cells) else 0):
            x, y = cells[int(self._rng.integers(len(cells)))]
            base = (float(x), float(y), float(self._rng.uniform(-math.pi, math.pi)))
            arm = self._noisy_arm(self._rng.uniform(-1.0, 1.0, 3))
            if arm is None or self._bench.robot_touches(base, arm, START_CLEARANCE_M):
                continue
            if not self._hand_too_near(base, arm):
                return _start(base, arm)
        raise RefusedError("no free floor to start on")

    def stand(self, target_m: Array) -> bool:
        """Whether a point (3,) can be reached from some free floor, without noise."""
        noise = self.noise
        cells = self._bench.floor().cells_by_distance(target_m, noise.clearance_m, noise.nearest_m)
        near = cells[np.linalg.norm(cells - target_m[:2], axis=1) < noise.farthest_m]
        rest = np.array(REST_QPOS_RAD)
        for cell in near[:: max(1, len(near) // noise.candidates)]:
            base = self._noisy_base(cell, target_m, np.zeros(6))
            if not self._bench.robot_touches(base, rest) and self.reaches(base, target_m):
                return True
        return False

    def reaches(self, base: Base, target_m: Array) -> bool:
        """Whether some arm pose brings the hand into grasping range without touching anything."""
        noise = self.noise
        local = in_base_frame(base, target_m)
        slack = noise.reach_radius_m
        if (local < np.array(EE_LOWER_M) - slack).any() or (
            local > np.array(EE_UPPER_M) + slack
        ).any():
            return False
        for _ in range(noise.reach_tries):
            direction = self._rng.normal(size=3)
            goal = local + slack * direction / np.linalg.norm(direction)
            arm = self._solve(self._rng.uniform(ARM_LOWER_RAD, ARM_UPPER_RAD), goal)
            if arm is not None and not self._bench.robot_touches(base, arm):
                return True
        return False

    def _hand_too_near(self, base: Base, arm: Array) -> bool:
        near = self._keep_off.meets(ee_in_world(self._kinematics, base, arm))
        if near:
            self.refused[HAND_TOO_NEAR] += 1
        return near

    def _noisy_base(self, cell: Array, target_m: Array, draw: Array) -> Base:
        return self._turned(cell + self.noise.base_m * draw[:2], target_m, draw[2])

    def _turned(self, point: Array, facing_m: Array, draw: float) -> Base:
        facing = math.atan2(facing_m[1] - point[1], facing_m[0] - point[0])
        return float(point[0]), float(point[1]), float(facing + self.noise.heading_rad * draw)

    def _noisy_arm(self, draw: Array) -> Array | None:
        """Returns the rest pose with the end-effector displaced by the noise; None off limits."""
        rest = np.array(REST_QPOS_RAD)
        return self._solve(rest, self._kinematics.position(rest) + self.noise.ee_m * draw)

    def _solve(self, arm: Array, goal_m: Array) -> Array | None:
        for _ in range(40):
            arm = self._kinematics.displace(arm, goal_m, damping=0.05)
        close = np.linalg.norm(self._kinematics.position(arm) - goal_m) < 0.005
        return arm if close else None


def in_base_frame(base: Base, point_m: Array) -> Array:
    """Returns a world point (3,) in the frame of a base pose; its height stays."""
    x, y = point_m[0] - base[0], point_m[1] - base[1]
    c, s = math.cos(base[2]), math.sin(base[2])
    return np.array([c * x + s * y, c * y - s * x, point_m[2]])


def ee_in_world(kinematics: ArmKinematics, base: Base, arm_qpos_rad: Array) -> Array:
    """Returns the end-effector point (3,) in the world."""
    above_floor = np.array([0.0, 0.0, BASE_HEIGHT_M])
    return apply(planar(*base), kinematics.position(arm_qpos_rad)) + above_floor


def _start(base: Base, arm: Array) -> RobotStart:
    x, y, yaw = (round(value, START_DIGITS) for value in base)
    return RobotStart(
        base=(x, y, yaw), arm_qpos_rad=tuple(round(float(q), START_DIGITS) for q in arm)
    )
