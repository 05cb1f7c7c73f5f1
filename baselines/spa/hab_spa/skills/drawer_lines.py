"""Grasps of a drawer's handle, and the arm motions that move it along a straight line.

A held handle is attached to the end-effector, so both move along the same line; the orientation
of the hand is free. Grasps are ranked by the length of the line that the arm can follow.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hab_spa.motion.robot import Robot
from hab_spa.planning.ik import IkConfig
from hab_spa.shapes import Array
from hab_tasks.privileged import ArticulationState


@dataclass(frozen=True, kw_only=True)
class LineConfig:
    """Parameters of grasps and lines.

    Attributes:
        starts: Random initial guesses for inverse kinematics per round.
        rounds: Maximum rounds, while no line covers the full travel.
        step_m: Step of the hand along the line.
        jump_rad: Maximum joint displacement per step.
        ik: Parameters of inverse kinematics per step.
        least_m: Minimum clearance of the grasp and along the line.
        room_m: Lines with this clearance at both ends are preferred: a drawer moves almost
            without resistance when touched.
        slack_m: Maximum missing travel of a complete line.
        lines: Number of lines to find.
        apart_rad: Minimum difference between two grasps, in the joint that differs most.
    """

    starts: int = 1000
    rounds: int = 8
    step_m: float = 0.02
    jump_rad: float = 0.35
    ik: IkConfig = field(default_factory=lambda: IkConfig(steps=4, damping=0.03))
    least_m: float = 0.003
    room_m: float = 0.03
    slack_m: float = 0.025
    lines: int = 4
    apart_rad: float = 0.3


@dataclass(frozen=True, kw_only=True, eq=False)
class Line:
    """Arm poses that move a held handle along its line.

    Attributes:
        poses: (K, J) [rad]; the first has the hand at the handle.
        missing_m: Travel that is missing at the end.
    """

    poses: Array
    missing_m: float


class HandleLines:
    """Finds lines for one drawer.

    Attributes:
        collision: Collision model with the drawer at its current position.
    """

    def __init__(
        self,
        robot: Robot,
        articulation: ArticulationState,
        travel_m: float,
        config: LineConfig,
        base: Array | None = None,
    ) -> None:
        """Builds the collision models.

        Args:
            robot: The robot.
            articulation: The drawer.
            travel_m: Travel along its axis.
            config: Parameters.
            base: Hypothetical base pose (3,); None for the current one.
        """
        self._robot, self._articulation, self._travel_m, self._config = (
            robot,
            articulation,
            travel_m,
            config,
        )
        self._steps = max(1, int(np.ceil(abs(travel_m) / config.step_m)))
        self.collision = self._moving = robot.scene.collision(base=base)
        if not self._move(0):
            self._moving = robot.scene.collision(base=base, without=articulation.body)

    def find(self, seed: int) -> list[Line]:
        """Returns the lines that move the handle farthest.

        Lines with more clearance come first, then those with less arm motion before and after.
        """
        config, rng, found = self._config, np.random.default_rng(seed), list[Line]()
        # Room is scarce where the handle is near the robot; lines sampled there extend best.
        ends = sorted((0, self._steps), key=lambda at: float(np.linalg.norm(self._handle_m(at))))
        for number in range(config.rounds):
            last = number > 0 and number == config.rounds - 1
            found += self._round(rng, ends[last])
            if any(line.missing_m <= config.slack_m for line in found):
                break
        self._move(0)
        least_m = min((line.missing_m for line in found), default=abs(self._travel_m))
        enough_m = max(least_m + 0.5 * config.step_m, config.slack_m)
        return [line for line in found if line.missing_m <= enough_m][: config.lines]

    def _round(self, rng: np.random.Generator, at: int) -> list[Line]:
        """Returns lines from samples of one end, until enough are complete."""
        config, found, complete = self._config, list[Line](), 0
        firsts = np.empty((0, len(self._robot.scene.arm_qpos)))
        for line in self._in_order(self._followed(self._grasps(rng, at), at)):
            apart_rad = np.abs(line[0] - firsts).max(axis=1).min(initial=np.inf)
            if apart_rad < config.apart_rad:
                continue
            free = self._free(line)
            if free > 1:
                missing_m = abs(self._travel_m) * (1.0 - (free - 1) / self._steps)
                found.append(Line(poses=line[:free], missing_m=missing_m))
                firsts = np.vstack((firsts, line[:1]))
                complete += missing_m <= config.slack_m
            if complete == config.lines:
                break
        return found

    def _grasps(self, rng: np.random.Generator, at: int) -> Array:
        """Returns collision-free arm poses (B, J) with the hand at the handle after `at` steps."""
        config, robot = self._config, self._robot
        starts = robot.kinematics.random(rng, config.starts)
        targets_m = np.repeat(self._handle_m(at)[None], config.starts, axis=0)
        poses, found = robot.kinematics.solve(starts, targets_m, robot.config.goal.ik)
        poses = poses[found]
        return poses[self._are_free(poses, at, config.least_m)]

    def _followed(self, poses: Array, at: int) -> list[Array]:
        """Returns the lines (K, J) through arm poses (B, J) at one end, without collision checks.

        They start at the current position of the handle.
        """
        config, stations = (
            self._config,
            range(at, self._steps + 1) if at == 0 else range(at, -1, -1),
        )
        lines, lengths = [poses], np.ones(len(poses), dtype=int)
        for station in stations[1:]:
            targets_m = np.repeat(self._handle_m(station)[None], len(poses), axis=0)
            pose, arrived = self._robot.kinematics.solve(lines[-1], targets_m, config.ik)
            smooth = np.abs(pose - lines[-1]).max(axis=1, initial=0.0) <= config.jump_rad
            lengths += arrived & smooth & (lengths == len(lines))
            lines.append(pose)
        stacked = np.stack(lines, axis=1)
        if at == 0:
            return [line[:length] for line, length in zip(stacked, lengths, strict=True)]
        return [line[::-1] for line in stacked[lengths == len(lines)]]

    def _in_order(self, lines: list[Array]) -> list[Array]:
        """Sorts lines by clearance, then by the arm motion before and after."""
        if not lines:
            return []
        firsts, lasts = np.array([ln[0] for ln in lines]), np.array([ln[-1] for ln in lines])
        whole = np.array([len(line) > self._steps for line in lines])
        room_m = self._config.room_m
        roomy = self._are_free(firsts, 0, room_m).astype(int)
        roomy += whole & self._are_free(lasts, self._steps, room_m)
        far_rad = np.abs(firsts - self._robot.scene.arm_qpos).max(axis=1)
        far_rad += np.abs(lasts - self._robot.kinematics.rest_rad).max(axis=1)
        return [lines[i] for i in np.lexsort((far_rad, -roomy))]

    def _free(self, line: Array) -> int:
        """Returns the number of leading poses of a line (K, J) that are collision-free."""
        for station, pose in enumerate(line):
            if not self._are_free(pose[None], station, self._config.least_m)[0]:
                return station
        return len(line)

    def _are_free(self, poses: Array, station: int, margin_m: float) -> NDArray[np.bool_]:
        """Whether arm poses (B, J) are collision-free with the drawer after `station` steps."""
        collision = self._moving if station else self.collision
        self._move(station)
        collision.set_margin(margin_m)
        return collision.are_free(poses)

    def _handle_m(self, station: int) -> Array:
        """Returns the handle's position (3,) after `station` steps, in the arm's root frame."""
        articulation, arm_from_world = self._articulation, self.collision.arm_from_world
        handle_m = articulation.handle_m + articulation.axis * (
            self._travel_m * station / self._steps
        )
        return arm_from_world[:3, :3] @ handle_m + arm_from_world[:3, 3]

    def _move(self, station: int) -> bool:
        """Moves the drawer in the model; returns whether the model contains it."""
        travel_m = self._travel_m * station / self._steps
        return self._moving.move(
            self._articulation.body, self._articulation.moved(self._articulation.joint + travel_m)
        )
