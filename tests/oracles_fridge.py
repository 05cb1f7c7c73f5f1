"""A scripted robot that sees everything opens and closes the fridge, in ``ee_base``.

It stands where nothing is near its base and its hand, takes the handle, pulls, and lets the
door swing on: hinges have next to no friction. All points are in the fridge's frame (x into the
room, y to the side, z up), whose origin is the fridge's on the floor.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
from fridge_room import BASE_FREE_M, Room, turned

from hab_tasks.constants import CONTROL_HZ, EE_STEP_M, REST_POSITION_M, SKILL_HORIZON_STEPS
from hab_tasks.fronts import FRIDGE_CLOSED_RAD, FRIDGE_OPEN_RAD
from hab_tasks.robots.fetch_spec import (
    BASE_ANGULAR_SPEED_RAD_S,
    BASE_LINEAR_SPEED_M_S,
    EE_LOWER_M,
    EE_UPPER_M,
    REST_QPOS_RAD,
)
from hab_tasks.robots.kinematics import ArmKinematics
from hab_tasks.skills.regions import SPAWN_REGION

LET_GO, GRASP = -1.0, 1.0
STEP_M = BASE_LINEAR_SPEED_M_S / CONTROL_HZ
STEP_RAD = BASE_ANGULAR_SPEED_RAD_S / CONTROL_HZ

ELBOW_TO_WRIST = (4, 5, 6, 7)
"""Numbers of these joints in the arm's model."""

GRIP_OUT_M = 0.10
"""The hand takes the handle of an open door from beyond its edge, this far off its outer face."""

DOOR_M, OFF_HINGE_M = 0.06, 0.95
"""Thickness of the door; so far from its hinge nothing is in its way."""

SPEED_LEFT = 0.8
"""Share of its speed that a swinging door keeps, on the safe side."""

MARGIN_M = 0.05
"""The base keeps this far inside the region that it must not leave."""


@dataclass(frozen=True, kw_only=True)
class Drive:
    """A turn, a straight way and a turn; `cost` is in steps, and what is in the way costs more."""

    heading_rad: float
    way_m: float
    yaw_rad: float
    cost: float


class FridgeRobot:
    """Steps one environment; reads what it needs in the fridge's frame.

    Attributes:
        base: x, y [m] and yaw [rad] of the base.
        hand_m: The end-effector (3,).
        handle_m: The handle (3,).
        hinge_m: A point (3,) of the door's hinge.
        joint_rad: How far the door is open.
        speed_rad: How much that changed in the last step.
        info: What the last step said.
        over: Whether the episode has ended.
        steps: How many actions were carried out.
    """

    def __init__(self, env, number: int = 0) -> None:
        """Plays `env`; the fridge has this number among its doors and drawers."""
        self.env, self.core, self._number = env, env.unwrapped, number
        self.steps, self.over, self.info, self.speed_rad = 0, False, {}, 0.0
        self._world, self._kinematics = self.core._world, ArmKinematics()
        self._front = np.asarray(self._world.goals.front[0, self._number], dtype=float)
        self.look()
        self.room = Room(self.core, self._front)

    def look(self) -> None:
        """Reads the latest snapshot."""
        shot, world = self._world.snapshot, self._world
        self.base = np.asarray(shot.base[0], dtype=float)
        self.base[2] -= self._front[2]
        self.base[:2] = self._local(np.append(self.base[:2], 0.0))[:2]
        self.hand_m = self._local(shot.ee_m[0])
        self.handle_m = self._local(shot.handles_m[0, self._number])
        handle = world._grasp.handles[int(world.tracker.handles[0, self._number])]
        self.hinge_m = self._local(handle.link.pose.p[0])
        self.joint_rad = float(shot.joints[0, self._number])

    def _local(self, point_m) -> np.ndarray:
        point = np.asarray(point_m, dtype=float).copy()
        point[:2] = (point[:2] - self._front[:2]) @ turned(self._front[2])
        return point

    def in_base(self, point_m, base=None) -> np.ndarray:
        """Returns a point (3,) in the frame of the base, or of another base pose."""
        base = self.base if base is None else base
        point = np.array(point_m, dtype=float)
        point[:2] = (point[:2] - base[:2]) @ turned(base[2])
        return point

    def handle_at(self, joint_rad: float) -> np.ndarray:
        """Returns where the handle is when the door is open by `joint_rad`."""
        # Seen from above the door turns clockwise.
        way = turned(self.joint_rad - joint_rad) @ (self.handle_m - self.hinge_m)[:2]
        return np.append(self.hinge_m[:2] + way, self.handle_m[2])

    def by_door(self, along_m: float, out_m: float, joint_rad: float | None = None) -> np.ndarray:
        """Returns a point so far from the hinge along the door and off its outer face."""
        angle = self.joint_rad if joint_rad is None else joint_rad
        thickness_m = DOOR_M if out_m >= 0 else 0.0
        # Closed, the door lies along y and its outer face looks along x.
        way = turned(-angle) @ (thickness_m + out_m, along_m)
        return np.append(self.hinge_m[:2] + way, self.handle_m[2])

    def act(self, gap_m=(0.0, 0.0, 0.0), gripper=LET_GO, forward=0.0, turn=0.0) -> None:
        """Moves the hand by a way (3,) in the base's frame; nothing when the episode is over."""
        if self.over:
            return
        action = np.concatenate((np.asarray(gap_m) / EE_STEP_M, (gripper, forward, turn)))
        action = np.clip(action, -1.0, 1.0).astype(np.float32)
        _, _, terminated, truncated, self.info = self.env.step(action)
        before, self.steps = self.joint_rad, self.steps + 1
        self.over = bool(terminated) or bool(truncated)
        self.look()
        self.speed_rad = self.joint_rad - before

    def gap_m(self, point_m) -> np.ndarray:
        """Returns the way (3,) of the hand to a point, in the base's frame."""
        return self.in_base(point_m) - self.in_base(self.hand_m)

    def hand_to(self, point_m, within_m: float, steps: int) -> None:
        """Moves the hand in a straight line to a point."""
        for _ in range(steps):
            if self.over or np.linalg.norm(self.hand_m - point_m) < within_m:
                return
            self.act(self.gap_m(point_m))

    def rest(self, steps: int = 200) -> None:
        """Brings the hand to rest, out of the door's way, and waits for the end."""
        for _ in range(steps):
            if self.over:
                return
            gap = np.array(REST_POSITION_M) - self.in_base(self.hand_m)
            forward, turn = self._out_of_the_way()
            self.act(gap, forward=forward, turn=turn)

    def _out_of_the_way(self) -> tuple[float, float]:
        """Returns how the base best takes the arm out of the circle that the door sweeps."""
        best, most_m = (0.0, 0.0), self._off_hinge_m(self.base) + 0.005
        allowed_m = max(self.room.lacking_m(self.base[None]), 0.02) + 0.01
        for move in ((-1.0, 0.0), (1.0, 0.0), (0.0, 0.6), (0.0, -0.6)):
            after = self._moved(*move)
            free = _inside(after[:2]) and self.room.lacking_m(after[None]) < allowed_m
            if free and OFF_HINGE_M > most_m < self._off_hinge_m(after):
                best, most_m = move, self._off_hinge_m(after)
        return best

    def _off_hinge_m(self, base: np.ndarray) -> float:
        """Returns how far arm at rest and body stay from the hinge for a base pose (3,)."""
        arm = self.room.arm_m[:, :2] @ turned(base[2]).T + base[:2] - self.hinge_m[:2]
        body = np.linalg.norm(base[:2] - self.hinge_m[:2]) - 0.15
        return float(min(np.linalg.norm(arm, axis=1).min(), body))

    def _swept_m(self, base: np.ndarray, point_m: np.ndarray) -> float:
        """Returns how far the arm, its hand at a point, is inside the circle of the door's edge."""
        arm, goal = np.array(REST_QPOS_RAD), self.in_base(point_m, base)
        for _ in range(80):
            gap = goal - self._kinematics.position(arm)
            if np.linalg.norm(gap) < 0.02:
                break
            step = np.clip(gap, -EE_STEP_M, EE_STEP_M)
            arm = self._kinematics.move(arm, step, np.array(EE_LOWER_M), np.array(EE_UPPER_M))
        joints = [self._kinematics._data.oMi[number].translation[:2] for number in ELBOW_TO_WRIST]
        world = np.array(joints) @ turned(base[2]).T + base[:2]
        off_hinge_m = np.linalg.norm(world - self.hinge_m[:2], axis=1)
        return float(np.maximum(0.82 - off_hinge_m, 0.0).max())

    def _moved(self, forward: float, turn: float, steps: int = 2) -> np.ndarray:
        """Returns the base pose (3,) after some steps."""
        x, y, yaw = self.base
        way = steps * STEP_M * forward
        moved = (x + way * math.cos(yaw), y + way * math.sin(yaw), yaw + steps * STEP_RAD * turn)
        return np.array(moved)

    def pull(self, ahead_m: np.ndarray, gripper: float = GRASP) -> None:
        """Moves what the hand holds towards a point, with the arm and the base."""
        gap = self.gap_m(ahead_m)
        way = gap / (np.linalg.norm(gap) + 1e-6)
        free = self.has_room(self._moved(math.copysign(1.0, way[0]), 0.0))
        self.act(gap, gripper, forward=0.7 * way[0] * free, turn=0.3 * way[1])

    def has_room(self, base: np.ndarray) -> bool:
        """Whether the base may stand at a pose (3,)."""
        return _inside(base[:2]) and bool(self.room.of_base(base) > BASE_FREE_M - 0.03)

    # Driving -----------------------------------------------------------------------------------

    def drive(self, plan: Drive) -> None:
        """Turns, goes and turns."""
        self._turn_to(plan.heading_rad)
        start = self.base[:2].copy()
        for _ in range(60):
            left = plan.way_m - math.copysign(np.linalg.norm(self.base[:2] - start), plan.way_m)
            if self.over or left * plan.way_m <= 0 or abs(left) < 0.02:
                break
            self.act(forward=left / STEP_M)
        self._turn_to(plan.yaw_rad)

    def _turn_to(self, yaw_rad: float) -> None:
        for _ in range(70):
            left = yaw_rad - self.base[2]
            if self.over or abs(left) < 0.03:
                return
            self.act(turn=left / STEP_RAD)

    def stand(
        self, best_m, reach: list[np.ndarray], hand_way: Callable, sweep: bool = False
    ) -> None:
        """Drives to where points are in reach of the hand, near a place, with room all the way.

        Args:
            best_m: Where to stand (2,) if all places were free.
            reach: Points (3,) that the hand has to come to.
            hand_way: (hand at rest (3,)) -> points (P, 3) it will pass first.
            sweep: Whether the arm has to stay out of the circle that the door sweeps.
        """
        self.room = Room(self.core, self._front)
        ends = []
        xs, ys = np.arange(0.99, 1.79, 0.06), np.arange(-0.54, 0.55, 0.06)
        middle = np.mean(reach, axis=0)
        for x, y, aside in product(xs, ys, (-0.9, -0.6, -0.3, 0.0, 0.3, 0.6, 0.9)):
            pose = np.array((x, y, math.atan2(middle[1] - y, middle[0] - x) + aside))
            if all(_reachable(self.in_base(point, pose)) for point in reach):
                away = float(np.hypot(x - best_m[0], y - best_m[1])) + 0.2 * abs(aside)
                ends.append((400 * self._lacking(pose, hand_way, sweep) + 60 * away, pose))
        ends.sort(key=lambda end: end[0])
        if sweep:
            ends = [(cost + 200 * self._swept_m(pose, reach[0]), pose) for cost, pose in ends[:300]]
            ends.sort(key=lambda end: end[0])
        drives = [(cost + d.cost, d) for cost, pose in ends[:60] for d in self._drives(pose)]
        if drives:
            self.drive(min(drives, key=lambda entry: entry[0])[1])

    def _lacking(self, pose: np.ndarray, hand_way: Callable, sweep: bool) -> float:
        ahead = np.array((math.cos(pose[2]), math.sin(pose[2])))
        hand = np.append(pose[:2] + REST_POSITION_M[0] * ahead, REST_POSITION_M[2])
        way = hand_way(hand)
        arm = np.linspace(pose[:2], way[-1][:2], 12)[4:9]
        short = 0.1 - self.room.of_hand(np.concatenate((way[:, :2], arm)))
        lacking = self.room.lacking_m(pose[None]) + float(np.maximum(short, 0.0).max())
        if sweep:
            lacking += max(0.0, 0.85 - self._off_hinge_m(pose))
        return lacking

    def _drives(self, goal: np.ndarray) -> list[Drive]:
        """Returns all ways of turning to a base pose (3,), forwards and backwards."""
        found, (x, y, yaw) = [], self.base
        way = goal[:2] - (x, y)
        for sign, first, last in product((1.0, -1.0), (0, 1), (0, 1)):
            heading = yaw + _either(math.atan2(*(sign * way)[::-1]) - yaw, first)
            end = heading + _either(goal[2] - heading, last)
            turn, back = np.linspace(yaw, heading, 16), np.linspace(heading, end, 16)
            line = np.linspace((x, y), goal[:2], 16)
            poses = np.concatenate(
                (
                    np.column_stack((np.tile((x, y), (16, 1)), turn)),
                    np.column_stack((line, np.full(16, heading))),
                    np.column_stack((np.tile(goal[:2], (16, 1)), back)),
                )
            )
            length = float(np.linalg.norm(way))
            steps = (abs(heading - yaw) + abs(end - heading)) / STEP_RAD + length / STEP_M
            cost = steps + 400 * self.room.lacking_m(poses)
            found.append(Drive(heading_rad=heading, way_m=sign * length, yaw_rad=end, cost=cost))
        return found

    # The door ----------------------------------------------------------------------------------

    def will_pass(self, joint_rad: float) -> bool:
        """Whether the door has passed a position, or swings there in time."""
        way = joint_rad - self.joint_rad
        if way * (1.0 if joint_rad > 1.0 else -1.0) <= 0:
            return True
        left = SKILL_HORIZON_STEPS - self.steps
        return self.speed_rad * way > 0 and abs(self.speed_rad) * SPEED_LEFT * left > abs(way)

    def pull_open(self) -> None:
        """Takes the handle, pulls until the door swings, and makes room for it."""
        handle = self.handle_m
        before = handle + np.array((0.12, 0.0, 0.0))
        reach = [handle, self.handle_at(0.5)]
        self.stand((1.25, 0.1), reach, lambda hand: np.linspace(hand, before, 8))
        self.hand_to(handle, 0.12, 60)
        for _ in range(80):
            if self.over or self.joint_rad > 0.5:
                break
            self.pull(self.handle_at(self.joint_rad + 0.2))
        for _ in range(10):
            gap = self.gap_m(self.by_door(1.0, 0.04, self.joint_rad + 0.1))
            self.act(gap, forward=-1.0 * self.has_room(self._moved(-1.0, 0.0)))

    def pull_shut(self) -> None:
        """Takes the handle from beyond the door's edge, and pulls until the door swings."""
        self.stand((1.55, -0.1), [self.by_door(0.75, GRIP_OUT_M)], self._to_edge, sweep=True)
        self.hand_to(self.by_door(0.95, GRIP_OUT_M), 0.04, 50)
        for step in range(40):
            near_m = 0.125 if step < 15 else 0.148
            if self.over or np.linalg.norm(self.hand_m - self.handle_m) < near_m:
                break
            self.act(self.gap_m(self.by_door(0.70, GRIP_OUT_M)))
        start = self.joint_rad
        for _ in range(60):
            if self.over or self.joint_rad < max(start - 0.5, 0.6):
                break
            self.pull(self.by_door(0.75, GRIP_OUT_M, self.joint_rad - 0.25))
        for _ in range(6):
            self.pull(self.by_door(1.05, GRIP_OUT_M, self.joint_rad - 0.25), LET_GO)

    def _to_edge(self, hand: np.ndarray) -> np.ndarray:
        edge = self.by_door(0.95, GRIP_OUT_M)
        return np.concatenate((np.linspace(hand, edge, 8), [self.by_door(0.85, GRIP_OUT_M)]))


def open_fridge(robot: FridgeRobot) -> None:
    """Pulls the door by its handle until it swings, and rests."""
    while not robot.over:
        if not robot.will_pass(FRIDGE_OPEN_RAD + 0.02):
            robot.pull_open()
        robot.rest(8)


def close_fridge(robot: FridgeRobot) -> None:
    """Pulls the door by its edge until it swings, and rests."""
    while not robot.over:
        if not robot.will_pass(FRIDGE_CLOSED_RAD - 0.01):
            robot.pull_shut()
        robot.rest(8)


def _either(angle_rad: float, other: int) -> float:
    """Returns the shorter turn by an angle, or the one in the other direction."""
    short = math.remainder(angle_rad, math.tau)
    return short - math.copysign(math.tau, short) if other else short


def _reachable(point_m: np.ndarray) -> bool:
    return 0.43 <= point_m[0] <= 0.95 and abs(point_m[1]) <= 0.6 and np.hypot(*point_m[:2]) < 1.0


def _inside(point_m: np.ndarray) -> bool:
    (x0, x1), (y0, y1) = SPAWN_REGION.x_m, SPAWN_REGION.y_m
    x, y = point_m
    return x0 + MARGIN_M <= x <= x1 - MARGIN_M and y0 + MARGIN_M <= y <= y1 - MARGIN_M
