"""Start poses of the robot: facing an object, in a spawn region at furniture, or anywhere free.

A start is collision-free with clearance. If the arm has to reach a point, some collision-free arm
pose brings the hand within grasping range of it.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np

from hab_tasks.articulations import Rectangle
from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.schema import Base, RobotStart
from hab_tasks.errors import RejectedSampleError
from hab_tasks.geometry import Array, apply, planar
from hab_tasks.robots.kinematics import ArmKinematics
from hab_tasks.robots.spec import RobotSpec

START_CLEARANCE_M = 0.015
"""Minimum clearance of the robot at the start of an episode."""

START_DIGITS = 6

HAND_CLEARANCE_M = 0.25
"""Minimum distance of the hand to the skill's target at the start. The hand snaps to everything
within 0.15 m; random actions that start 0.2 m away still solve 8 % of Place (4 of 50)."""

FINGERS_REACH_M = 0.05
"""Distance to which fingers that grasp by friction have to reach, instead of
`StartNoise.reach_radius_m`."""

HAND_TOO_NEAR = f"the hand starts within {HAND_CLEARANCE_M} m of its target"
"""Rejection reason, counted per pose; the next pose is tried."""


@dataclass(frozen=True, kw_only=True)
class StartNoise:
    """Start noise (S H.2), uniform in plus and minus its value, and search parameters.

    `RobotStarts.around` takes the values as standard deviations.

    Attributes:
        base_m: Noise of the base's x and y.
        heading_rad: Noise of the base's heading.
        ee_m: Noise of the end-effector's x, y and z.
        clearance_m: Free radius around the base.
        nearest_m: Minimum distance of the base to the point it faces.
        farthest_m: Maximum distance of the base to the point it faces.
        candidates: Maximum number of base poses tried.
        reach_tries: Maximum number of arm poses tried to reach a point.
        reach_radius_m: Maximum distance of the hand to a reached point.
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
class KeepOff:
    """Points that the hand must be clear of at the start.

    Attributes:
        points_m: (K, 3) in the world.
        level: Whether only the horizontal distance counts.
        radius_m: Minimum distance of the end-effector to each of them.
    """

    points_m: Array
    level: bool = False
    radius_m: float = HAND_CLEARANCE_M

    def meets(self, hand_m: Array) -> bool:
        """Whether an end-effector position (3,) is too close to one of the points."""
        axes = 2 if self.level else 3
        gaps_m = np.linalg.norm((self.points_m - hand_m)[:, :axes], axis=1)
        return bool((gaps_m < self.radius_m).any())


NOTHING_NEAR = KeepOff(points_m=np.empty((0, 3)))


class RobotStarts:
    """Samples start poses in the current layout of a sandbox.

    `refused` counts rejected collision-free poses by reason.
    """

    def __init__(
        self,
        sandbox: PlacementSandbox,
        rng: np.random.Generator,
        kinematics: ArmKinematics,
        noise: StartNoise = StartNoise(),
        keep_off: KeepOff = NOTHING_NEAR,
    ) -> None:
        """Samples starts with the hand clear of `keep_off`."""
        self._sandbox, self._rng, self._kinematics = sandbox, rng, kinematics
        self.noise, self._keep_off = noise, keep_off
        self.refused: Counter[str] = Counter()

    def facing(self, target_m: Array) -> RobotStart:
        """Returns a start on the nearest free floor from which a point (3,) can be reached.

        Raises:
            RejectedSampleError: There is none.
        """
        noise = self.noise
        near = self._sandbox.floor().cells_around(
            target_m, noise.clearance_m, noise.nearest_m, noise.farthest_m
        )
        if not len(near):
            raise RejectedSampleError("no free floor near the target")
        reason = "target out of reach"
        for cell in near[:: max(1, len(near) // noise.candidates)]:
            draw = self._rng.uniform(-1.0, 1.0, 6)
            base = self._noisy_base(cell, target_m, draw)
            arm = self._noisy_arm(draw[3:])
            if arm is None or self._sandbox.robot_touches(base, arm, START_CLEARANCE_M):
                reason = "robot too close to something at its start"
            elif self._hand_too_near(base, arm):
                reason = "no place has the hand off its target"
            elif self.reaches(base, target_m):
                return self._start(base, arm)
        raise RejectedSampleError(reason)

    def in_rectangle(
        self,
        world_from_frame: Array,
        region: Rectangle,
        facing_m: Array,
        reach: bool,
        end_m: Array | None = None,
    ) -> RobotStart:
        """Returns a start in a spawn region, noise included, facing a point (3,).

        The x axis of the region's frame (4, 4) points into the room. With `reach`, the arm must
        reach that point; `end_m` (3,) is in the workspace, and in reach of fingers, as the hand has
        to move something there.

        Raises:
            RejectedSampleError: The region has no free pose.
        """
        reason = "no free floor in the spawn region"
        floor = self._sandbox.floor()
        for _ in range(self.noise.candidates):
            x = self._rng.uniform(*region.x_m)
            y = self._rng.uniform(*region.y_m)
            point = (world_from_frame @ np.array([x, y, 0.0, 1.0]))[:2]
            draw = self._rng.uniform(-1.0, 1.0, 4)
            if floor.clearance_at(point) < self.noise.clearance_m:
                continue
            base = self._turned(point, facing_m, draw[0])
            arm = self._noisy_arm(draw[1:])
            if arm is None or self._sandbox.robot_touches(base, arm, START_CLEARANCE_M):
                reason = "robot too close to something at its start"
            elif self._hand_too_near(base, arm):
                reason = "no place has the hand off its target"
            elif end_m is not None and not self._leads_to(base, end_m):
                reason = "the handle would have to leave the workspace"
            elif not reach or self.reaches(base, facing_m):
                return self._start(base, arm)
            else:
                reason = "handle out of reach"
        raise RejectedSampleError(reason)

    def around(self, point: Array, yaw_rad: float, target_m: Array) -> RobotStart:
        """Returns a start around a base pose from which a point (3,) can be reached (S F.2).

        The noise is normal; `StartNoise` has its standard deviations.

        Args:
            point: (2,) position of the base without noise.
            yaw_rad: Heading without noise.
            target_m: The point to be reached.

        Raises:
            RejectedSampleError: No pose was free and in reach.
        """
        noise, floor = self.noise, self._sandbox.floor()
        reason = "no free floor around the base pose"
        for _ in range(noise.candidates):
            draw = self._rng.normal(size=6)
            x, y = point + noise.base_m * draw[:2]
            if floor.clearance_at(np.array([x, y])) < noise.clearance_m:
                continue
            base = (float(x), float(y), yaw_rad + noise.heading_rad * float(draw[2]))
            arm = self._noisy_arm(draw[3:])
            if arm is None or self._sandbox.robot_touches(base, arm, START_CLEARANCE_M):
                reason = "robot too close to something at its start"
            elif not self._hand_too_near(base, arm) and self.reaches(base, target_m):
                return self._start(base, arm)
            else:
                reason = "target too near or out of reach"
        raise RejectedSampleError(reason)

    def anywhere(self, away_from_m: Array | None = None, distance_m: float = 0.0) -> RobotStart:
        """Returns a random free pose with random heading, with a minimum distance to a point (2,).

        Raises:
            RejectedSampleError: No free pose was found.
        """
        floor = self._sandbox.floor()
        centre = np.zeros(2) if away_from_m is None else away_from_m
        cells = floor.cells_by_distance(centre, self.noise.clearance_m, distance_m)
        for _ in range(self.noise.candidates if len(cells) else 0):
            x, y = cells[int(self._rng.integers(len(cells)))]
            base = (float(x), float(y), float(self._rng.uniform(-math.pi, math.pi)))
            arm = self._noisy_arm(self._rng.uniform(-1.0, 1.0, 3))
            if arm is None or self._sandbox.robot_touches(base, arm, START_CLEARANCE_M):
                continue
            if not self._hand_too_near(base, arm):
                return self._start(base, arm)
        raise RejectedSampleError("no free floor to start on")

    def stand(self, target_m: Array) -> bool:
        """Whether a point (3,) can be reached from the free floor, without noise."""
        noise = self.noise
        near = self._sandbox.floor().cells_around(
            target_m, noise.clearance_m, noise.nearest_m, noise.farthest_m
        )
        rest = np.array(self._kinematics.robot.rest_qpos_rad)
        for cell in near[:: max(1, len(near) // noise.candidates)]:
            base = self._noisy_base(cell, target_m, np.zeros(6))
            if not self._sandbox.robot_touches(base, rest) and self.reaches(base, target_m):
                return True
        return False

    def reaches(self, base: Base, target_m: Array) -> bool:
        """Whether a collision-free arm pose brings the hand within grasping range."""
        noise, robot = self.noise, self._kinematics.robot
        slack = noise.reach_radius_m if robot.fingers is None else FINGERS_REACH_M
        if not in_workspace(robot, base, target_m, slack):
            return False
        local = in_base_frame(base, target_m)
        for _ in range(noise.reach_tries):
            direction = self._rng.normal(size=3)
            goal = local + slack * direction / np.linalg.norm(direction)
            arm = self._solve(self._rng.uniform(robot.arm_lower_rad, robot.arm_upper_rad), goal)
            if arm is not None and not self._sandbox.robot_touches(base, arm):
                return True
        return False

    def _leads_to(self, base: Base, end_m: Array) -> bool:
        """Whether the hand can bring a handle to a point (3,)."""
        robot, local = self._kinematics.robot, in_base_frame(base, end_m)
        if not in_workspace(robot, base, end_m):
            return False
        if robot.fingers is None:
            return True
        # The workspace is that of the snap grasp's point, which is beyond the fingers.
        limits = robot.arm_lower_rad, robot.arm_upper_rad
        starts = (self._rng.uniform(*limits) for _ in range(self.noise.reach_tries))
        return any(self._solve(start, local) is not None for start in starts)

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
        """Returns the rest pose with a noisy end-effector; None beyond the joint limits."""
        rest = np.array(self._kinematics.robot.rest_qpos_rad)
        return self._solve(rest, self._kinematics.position(rest) + self.noise.ee_m * draw)

    def _start(self, base: Base, arm: Array) -> RobotStart:
        x, y, yaw = (round(value, START_DIGITS) for value in base)
        rounded = (round(float(q), START_DIGITS) for q in arm)
        return RobotStart.of(self._kinematics.robot, (x, y, yaw), rounded)

    def _solve(self, arm: Array, goal_m: Array) -> Array | None:
        arm = self._kinematics.approach(arm, goal_m, steps=40, damping=0.05)
        close = np.linalg.norm(self._kinematics.position(arm) - goal_m) < 0.005
        return arm if close else None


def in_workspace(robot: RobotSpec, base: Base, point_m: Array, slack_m: float = 0.0) -> bool:
    """Whether a world point (3,) is in the end-effector's workspace box, or near it."""
    local = in_base_frame(base, point_m)
    low, high = np.array(robot.ee_lower_m) - slack_m, np.array(robot.ee_upper_m) + slack_m
    return bool((local >= low).all() and (local <= high).all())


def in_base_frame(base: Base, point_m: Array) -> Array:
    """Returns a world point (3,) in the frame of a base pose; its height is kept."""
    x, y = point_m[0] - base[0], point_m[1] - base[1]
    c, s = math.cos(base[2]), math.sin(base[2])
    return np.array([c * x + s * y, c * y - s * x, point_m[2]])


def ee_in_world(kinematics: ArmKinematics, base: Base, arm_qpos_rad: Array) -> Array:
    """Returns the end-effector point (3,) in the world."""
    above_floor = np.array([0.0, 0.0, kinematics.robot.base_height_m])
    return apply(planar(*base), kinematics.position(arm_qpos_rad)) + above_floor
