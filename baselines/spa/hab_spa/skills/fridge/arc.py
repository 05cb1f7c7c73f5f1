"""Arm motions that follow the arc of the fridge's handle."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]  # compiled, no stubs
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hab_spa.planning.arm_plan import path_rad
from hab_spa.planning.collision import ArmCollision
from hab_spa.planning.ik import BatchArm
from hab_spa.shapes import Array, invert_pose
from hab_spa.skills.fridge.door import Door
from hab_spa.skills.fridge.tow import TowConfig, with_base
from hab_tasks.privileged import ArticulationState
from hab_tasks.robots.kinematics import arm_model
from hab_tasks.robots.spec import RobotSpec


@dataclass(frozen=True, kw_only=True)
class ArcConfig:
    """Parameters of following the handle.

    Attributes:
        step_rad: Step of the door's joint.
        orientations: Orientations of the hand: share of the door's rotation, and weight of an
            orientation error [m/rad].
        margin_m: Clearance along the arc.
        steps: Iterations of inverse kinematics per step ...
        missed_m: ... and maximum position error.
        pace_rad: Joint displacement per control step, for estimating durations.
        detour: Length of the path to the handle, relative to a straight line.
        again_steps: Cost of another grasp [steps], constant and per radian of remaining rotation.
        behind_rad: Lag of an opening door behind a hand at its edge or behind it: the handle is
            drawn in until the fingers touch the door's other side.
        draws_in: Whether the grasp draws the handle to a hand in front of it, as the snap grasp
            does; else the hand keeps its place at the handle.
        before_m: A hand is in front of the door if it is this much farther out than the handle.
        tow: Parameters of base motion during a pull.
    """

    step_rad: float = 0.08
    orientations: tuple[tuple[float, float], ...] = ((0.0, 0.0), (0.5, 0.05), (1.0, 0.05))
    margin_m: float = 0.003
    steps: int = 4
    missed_m: float = 0.01
    pace_rad: float = 0.05
    detour: float = 2.0
    again_steps: tuple[float, float] = (60.0, 60.0)
    behind_rad: float = 0.09
    draws_in: bool = True
    before_m: float = 0.01
    tow: TowConfig = field(default_factory=TowConfig)


@dataclass(frozen=True, kw_only=True)
class Pull:
    """Specification of a door motion.

    Attributes:
        end: Target joint position of the hand's motion [rad].
        need: Joint position that is sufficient for one pull [rad].
        complete: Joint position at which the door is completely open or closed [rad].
        swept: Range of joint positions that must be clear of the robot [rad].
        grasps_m: (along, out) grasp points in the door's frame.
        opening: Whether the door is opened.
    """

    end: float
    need: float
    complete: float
    swept: tuple[float, float]
    grasps_m: tuple[tuple[float, float], ...]
    opening: bool

    def is_sufficient(self, joint: float) -> bool:
        """Whether a joint position is sufficient for one pull."""
        return joint >= self.need if self.opening else joint <= self.need

    def is_complete(self, joint: float) -> bool:
        """Whether the door is completely open or closed at a joint position."""
        return joint >= self.complete if self.opening else joint <= self.complete


@dataclass(frozen=True, kw_only=True, eq=False)
class DoorPath:
    """A candidate pull: paths of arm and base that move the door.

    Attributes:
        goal: (J,) grasp pose of the arm.
        arc: (K, J) arm poses along the handle's arc.
        bases: (K, 3) base poses; identical if the base does not move.
        joints: (K,) joint positions of the door [rad].
        sufficient: Whether the pull is sufficient.
        complete: Whether it opens or closes the door completely.
        share: Rotation of the door, relative to the sufficient one.
        cost: Estimated steps, including the motion to rest.
    """

    goal: Array
    arc: Array
    bases: Array
    joints: Array
    sufficient: bool
    complete: bool
    share: float
    cost: float

    @property
    def towed(self) -> bool:
        """Whether the base moves."""
        return bool(np.ptp(self.bases, axis=0).any())


class Arcs:
    """Computes pulls of a door in its current state, from grasp poses of the arm."""

    def __init__(
        self, articulation: ArticulationState, arm: BatchArm, pull: Pull, config: ArcConfig
    ) -> None:
        self._articulation, self._arm, self._pull, self._config = articulation, arm, pull, config
        self.door = Door(articulation)
        count = 1 + round(abs(pull.end - articulation.joint) / config.step_rad)
        self._joints = np.linspace(articulation.joint, pull.end, count)
        turns = np.stack([articulation.moved(float(joint))[:3, :3] for joint in self._joints])
        shares, self._weights = np.array(config.orientations).T
        rotvecs = shares[:, None] * Rotation.from_matrix(turns).as_rotvec()[:, None]
        # (K, O, 3, 3): rotations of the hand along the pull, for each of its orientations.
        self._turns = Rotation.from_rotvec(rotvecs.reshape(-1, 3)).as_matrix()
        self._turns = self._turns.reshape(count, len(shares), 3, 3)

    @property
    def joints(self) -> Array:
        """Joint positions of the door along the pull (K,) [rad]."""
        return self._joints

    def candidates(
        self, here: Array, goals: Array, collision: ArmCollision, tows: Array
    ) -> list[DoorPath]:
        """Returns the pulls from grasp poses (G, J).

        Args:
            here: Current arm pose (J,).
            goals: Grasp poses.
            collision: Collision model; its door and robot are moved.
            tows: Base motions (T, K, 3), all from the same base pose.
        """
        if not len(goals) or not len(tows):
            return []
        collision.set_margin(self._config.margin_m)
        entries = list(product(range(len(tows)), goals, range(len(self._weights))))
        starts = np.stack([goal for _, goal, _ in entries])
        towed = np.array([tow for tow, _, _ in entries])
        collision.stand_at(tows[0, 0])
        before = self.are_before(starts, collision)
        orientations = np.array([orientation for _, _, orientation in entries])
        arcs = self._follow(starts, orientations, towed, tows, collision)
        keeps_up = before | (not self._pull.opening) | (not self._config.draws_in)
        lags = np.where(keeps_up, 0.0, self._config.behind_rad)
        return [
            self._door_path(here, start, np.array(arc), tows[tow, : len(arc)], lag)
            for start, arc, tow, lag in zip(starts, arcs, towed, lags, strict=True)
            if len(arc) > 1
        ]

    def are_before(self, goals: Array, collision: ArmCollision) -> NDArray[np.bool_]:
        """Whether the hand is in front of the door, not at its edge or behind, for poses (G, J)."""
        if not len(goals):
            return np.zeros(0, dtype=bool)
        return self._before(
            self._beside(np.stack([self._arm.ee_pose(g) for g in goals]), collision)
        )

    def _follow(
        self,
        starts: Array,
        orientations: NDArray[np.int64],
        towed: NDArray[np.int64],
        tows: Array,
        collision: ArmCollision,
    ) -> list[list[Array]]:
        """Returns the arm poses along the arc from each start (E, J), up to the first collision.

        Args:
            starts: Grasp poses.
            orientations: Index (E,) of the hand's orientation, see `ArcConfig.orientations`.
            towed: Index of the base motion of each entry (E,).
            tows: Base motions (T, K, 3).
            collision: Collision model.
        """
        arcs: list[list[Array]] = [[] for _ in starts]
        poses, going = starts, np.arange(len(starts))
        hands = np.stack([self._arm.ee_pose(pose) for pose in starts])
        positions = self._positions(hands, collision)
        hands = invert_pose(collision.arm_from_world) @ hands
        for number, joint in enumerate(self._joints):
            motion = self._articulation.moved(float(joint))
            collision.move(self._articulation.body, motion)
            goals = hands[going]
            goals[:, :3, :3] = self._turns[number, orientations[going]] @ goals[:, :3, :3]
            places = slice(0, 3 if self._config.draws_in else 2)
            goals[:, places, 3] = self.door.points(float(joint), positions[going])[:, places]
            bases = tows[towed[going], number]
            goals = invert_pose(collision.world_from_arms(bases)) @ goals
            weights = self._weights[orientations[going]]
            poses = self._arm.track_poses(poses, goals, self._config.steps, weights)
            missed_m = np.linalg.norm(self._arm.positions_m(poses) - goals[:, :3, 3], axis=1)
            on = missed_m <= self._config.missed_m
            on[on] = collision.are_free(poses[on], bases[on])
            going, poses = going[on], poses[on]
            for entry, pose in zip(going, poses, strict=True):
                arcs[entry].append(pose)
            if not len(going):
                break
        return arcs

    def _positions(self, hands: Array, collision: ArmCollision) -> Array:
        """Returns the positions (along, out) (G, 2) of hands (G, 4, 4) during a pull.

        The snap grasp draws the handle to a hand in front of it; a hand at the door's edge or
        behind it keeps its position relative to the door.
        """
        positions = self._beside(hands, collision)
        drawn = self._before(positions) & self._config.draws_in
        return np.where(drawn[:, None], self.door.handle_m, positions)

    def _beside(self, hands: Array, collision: ArmCollision) -> Array:
        """Returns the positions (G, 2) of hands (G, 4, 4) in the door's frame."""
        world_from_arm = invert_pose(collision.arm_from_world)
        points = hands[:, :3, 3] @ world_from_arm[:3, :3].T + world_from_arm[:3, 3]
        return self.door.beside(points, self._articulation.joint)

    def _before(self, positions: Array) -> NDArray[np.bool_]:
        return positions[:, 1] > self.door.handle_m[1] + self._config.before_m

    def _door_path(
        self, here: Array, goal: Array, arc: Array, bases: Array, lag_rad: float
    ) -> DoorPath:
        config, joints = self._config, self._joints[: len(arc)]
        last = float(joints[-1]) - lag_rad
        sufficient, complete = self._pull.is_sufficient(last), self._pull.is_complete(last)
        cost = config.detour * float(np.abs(goal - here).max())
        cost += path_rad(with_base(arc, bases, config.tow))
        cost += float(np.abs(arc[-1] - self._arm.rest_rad).max())
        cost /= config.pace_rad
        if not complete:
            once, for_a_radian = config.again_steps
            cost += once + for_a_radian * abs(last - self._pull.complete)
        if not sufficient:
            cost += 1000.0 * abs(last - self._pull.need)
        share = float((last - joints[0]) / (self._pull.need - joints[0]))
        return DoorPath(
            goal=goal,
            arc=arc,
            bases=bases,
            joints=joints,
            sufficient=sufficient,
            complete=complete,
            share=share,
            cost=cost,
        )


def best_first(candidates: list[DoorPath]) -> list[DoorPath]:
    """Sorts pulls: sufficient ones first, then by cost."""
    return sorted(candidates, key=lambda candidate: (not candidate.sufficient, candidate.cost))


def arm_points_m(robot: RobotSpec, qpos: Array) -> Array:
    """Returns points (K, P, 3) along the forearm of arm poses (K, J), in the arm's root frame."""
    model, frame = arm_model(robot)
    data, found, elbow = model.createData(), [], model.getJointId(robot.elbow_joint)
    for pose in qpos:
        pin.forwardKinematics(model, data, pose)
        ee = pin.updateFramePlacement(model, data, frame).translation
        joints = [data.oMi[number].translation for number in range(elbow, model.njoints)]
        corners = np.array([*joints, ee])
        middles = (corners[1:] + corners[:-1]) / 2
        points = np.empty((2 * len(corners) - 1, 3))
        points[::2], points[1::2] = corners, middles
        found.append(points)
    return np.array(found)
