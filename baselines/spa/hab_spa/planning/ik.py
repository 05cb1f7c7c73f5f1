"""Batched inverse kinematics of the robot's arm, in numpy and compiled.

The forward kinematics is a batched version of Pinocchio's; a test compares the two.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]  # compiled, no stubs
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from hab_spa.planning.batch import chain_of, ik_kernel, rows_of
from hab_spa.shapes import Array
from hab_tasks.robots.kinematics import arm_model
from hab_tasks.robots.spec import RobotSpec


@dataclass(frozen=True, kw_only=True)
class IkConfig:
    """Parameters of damped least squares.

    Attributes:
        steps: Maximum number of iterations.
        damping: Damping factor, in the unit of the Jacobian [m/rad].
        step_m: Maximum position error corrected per iteration.
        tolerance_m: Maximum position error of a solution.
    """

    steps: int = 20
    damping: float = 0.05
    step_m: float = 0.2
    tolerance_m: float = 0.005


@dataclass(frozen=True, kw_only=True, eq=False)
class Tool:
    """A point fixed to the end-effector, with an upright direction.

    Attributes:
        point_m: (3,) position in the end-effector's frame.
        up: (3,) direction in that frame that should point up.
        tilt_weight_m: Weight of the tilt [m/rad].
        tilt_rad: Tilt at which inverse kinematics stops.
        step_rad: Maximum tilt corrected per iteration.
    """

    point_m: Array
    up: Array
    tilt_weight_m: float = 0.03
    tilt_rad: float = 0.1
    step_rad: float = 0.5


class BatchArm:
    """End-effector position and Jacobian of the arm for (B, J) poses, in the arm's root frame.

    Attributes:
        robot: The robot.
        limits_rad: Lower and upper limits (J,).
        rest_rad: (J,) resting pose.
        ends_in_roll: Whether the last joint's axis passes through the end-effector.
    """

    def __init__(self, robot: RobotSpec) -> None:
        self.robot = robot
        self.limits_rad = np.array(robot.arm_lower_rad), np.array(robot.arm_upper_rad)
        self.rest_rad = np.array(robot.rest_qpos_rad)
        self._model, self._frame_id = arm_model(robot)
        self._data = self._model.createData()
        axes = chain_of(robot)[:, 12].astype(int)
        self._axes, self._slides = axes.tolist(), axes > 2
        self._placements = list(self._model.jointPlacements)[1:]
        wrist_from_ee = self._model.frames[self._frame_id].placement
        self._wrist_from_ee_m, self._turn = wrist_from_ee.translation, wrist_from_ee.rotation
        aside_m = np.delete(self._wrist_from_ee_m, self._axes[-1] % 3)
        self.ends_in_roll = self._axes[-1] < 3 and bool(np.abs(aside_m).max() < 1e-6)

    def random(self, rng: np.random.Generator, count: int) -> Array:
        """Samples arm poses (count, J) within the limits."""
        return rng.uniform(*self.limits_rad, (count, len(self.rest_rad)))

    def position_and_jacobian(self, qpos: Array) -> tuple[Array, Array]:
        """Returns (B, 3) positions [m] and (B, 3, J) Jacobians [m/rad] of poses (B, J) [rad]."""
        position, jacobian, _, _ = self._chain(qpos, np.zeros(3))
        return position, jacobian

    def positions_m(self, qpos: Array) -> Array:
        """Returns the end-effector's positions (B, 3) at arm poses (B, J)."""
        return self.position_and_jacobian(qpos)[0]

    def points_m(self, qpos: Array, tool: Tool) -> Array:
        """Returns the positions (B, 3) of a tool in the arm's root frame, for poses (B, J)."""
        return self._chain(qpos, tool.point_m)[0]

    def tilts_rad(self, qpos: Array, tool: Tool) -> Array:
        """Returns the tilts (B,) of a tool, for poses (B, J)."""
        up = self._chain(qpos, tool.point_m)[3] @ (self._turn @ tool.up)
        return np.arccos(np.clip(up[:, 2], -1.0, 1.0))

    def _chain(self, qpos: Array, point_m: Array) -> tuple[Array, Array, Array, Array]:
        """Returns a point's positions and Jacobians, the joints' axes and the wrist's rotations."""
        batch = len(qpos)
        rotation = np.broadcast_to(np.eye(3), (batch, 3, 3))
        position = np.zeros((batch, 3))
        axes, origins = np.empty((2, batch, len(self._axes), 3))
        for i, (axis, placement) in enumerate(zip(self._axes, self._placements, strict=True)):
            position = position + rotation @ placement.translation
            rotation = rotation @ placement.rotation
            axes[:, i], origins[:, i] = rotation[:, :, axis % 3], position
            if axis > 2:
                position = position + qpos[:, i, None] * axes[:, i]
            else:
                rotation = _turned(rotation, axis, qpos[:, i])
        position = position + rotation @ (self._wrist_from_ee_m + self._turn @ point_m)
        arms = position[:, None] - origins
        jacobian = np.cross(axes, arms).astype(np.float64, copy=False)
        if self._slides.any():
            jacobian[:, self._slides], axes[:, self._slides] = axes[:, self._slides], 0.0
        return position, jacobian.transpose(0, 2, 1), axes.transpose(0, 2, 1), rotation

    def solve(
        self, qpos: Array, targets_m: Array, config: IkConfig, tool: Tool | None = None
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Moves arm poses (B, J) to targets (B, 3) of the end-effector, or of a tool.

        Targets are in the arm's root frame, whose z points up.

        Returns:
            The poses (B, J), within the limits, and whether each reached its target (B,) bool.
        """
        qpos = np.array(qpos)
        active = np.arange(len(qpos))
        reached = np.zeros(len(qpos), dtype=bool)
        # The last round moves nothing: it tells what has been reached.
        for step in range(config.steps + 1):
            point_m = np.zeros(3) if tool is None else tool.point_m
            position, jacobian, axes, rotation = self._chain(qpos[active], point_m)
            error = targets_m[active] - position
            distance = np.linalg.norm(error, axis=1)
            # Half of the tolerance is reserved for rounding and for control errors.
            done = distance < 0.5 * config.tolerance_m
            # By position alone: a tilted object is accepted, at a cost
            # (`PlacingConfig.tilt_cost_m`).
            reached[active] = done
            error *= np.minimum(1.0, config.step_m / np.maximum(distance, 1e-9))[:, None]
            if tool is not None:
                turn = _righting(rotation @ (self._turn @ tool.up))
                tilt_rad = np.linalg.norm(turn, axis=1)
                done &= tilt_rad < tool.tilt_rad
                turn *= np.minimum(1.0, tool.step_rad / np.maximum(tilt_rad, 1e-9))[:, None]
                error = np.concatenate((error, tool.tilt_weight_m * turn), axis=1)
                jacobian = np.concatenate((jacobian, tool.tilt_weight_m * axes[:, :2]), axis=1)
            if step == config.steps or done.all():
                break
            delta = _damped_step(jacobian[~done], error[~done], config.damping)
            active = active[~done]
            qpos[active] = np.clip(qpos[active] + delta, *self.limits_rad)
        return qpos, reached

    def ee_pose(self, qpos: Array) -> Array:
        """Returns the end-effector's pose (4, 4) in the arm's root frame, for one pose (J,)."""
        pin.forwardKinematics(self._model, self._data, qpos)
        return pin.updateFramePlacement(self._model, self._data, self._frame_id).homogeneous

    def track_pose(
        self, qpos: Array, arm_from_ee: Array, steps: int, turn_weight_m: float
    ) -> Array:
        """Moves one arm pose (J,) to an end-effector pose (4, 4) by `steps` damped iterations.

        `turn_weight_m` is the weight of an orientation error [m/rad].
        """
        goal = pin.SE3(arm_from_ee)
        weights = np.array([1.0] * 3 + [turn_weight_m] * 3)
        for _ in range(steps):
            here = pin.SE3(self.ee_pose(qpos))
            # The logarithm is in the hand's frame, the Jacobian along the axes of the root.
            turn = here.rotation @ pin.log3(here.rotation.T @ goal.rotation)
            error = weights * np.concatenate((goal.translation - here.translation, turn))
            jacobian = weights[:, None] * pin.computeFrameJacobian(
                self._model, self._data, qpos, self._frame_id, pin.LOCAL_WORLD_ALIGNED
            )
            delta = _damped_step(jacobian[None], error[None], 0.02)[0]
            qpos = np.clip(qpos + delta, *self.limits_rad)
        return qpos

    def track_poses(
        self, qpos: Array, arm_from_ee: Array, steps: int, turn_weights_m: Array
    ) -> Array:
        """Batched `track_pose`: arm poses (B, J), poses (B, 4, 4) and weights (B,)."""
        weights = np.ones((len(qpos), 6))
        weights[:, 3:] = turn_weights_m[:, None]
        for _ in range(steps):
            position, jacobian, axes, rotation = self._chain(qpos, np.zeros(3))
            off = arm_from_ee[:, :3, :3] @ self._turn.T @ rotation.transpose(0, 2, 1)
            turn = Rotation.from_matrix(off).as_rotvec()
            error = np.concatenate((arm_from_ee[:, :3, 3] - position, turn), axis=1)
            whole = np.concatenate((jacobian, axes), axis=1)
            delta = _damped_step(weights[:, :, None] * whole, weights * error, 0.02)
            qpos = np.clip(qpos + delta, *self.limits_rad)
        return qpos


def _turned(rotation: Array, axis: int, angle_rad: Array) -> Array:
    """Returns rotations (B, 3, 3) followed by a rotation (B,) about their own axis 0, 1 or 2."""
    cos, sin = np.cos(angle_rad)[:, None], np.sin(angle_rad)[:, None]
    u, v = (axis + 1) % 3, (axis + 2) % 3
    turned = np.empty_like(rotation)
    turned[:, :, axis] = rotation[:, :, axis]
    turned[:, :, u] = cos * rotation[:, :, u] + sin * rotation[:, :, v]
    turned[:, :, v] = cos * rotation[:, :, v] - sin * rotation[:, :, u]
    return turned


def _righting(up: Array) -> Array:
    """Returns the rotations about x and y (B, 2) [rad] that turn directions (B, 3) upright.

    A rotation about z does not change the tilt.
    """
    across = np.stack((up[:, 1], -up[:, 0]), axis=1)
    length = np.linalg.norm(across, axis=1)
    angle = np.arctan2(length, up[:, 2])
    return across * (angle / np.maximum(length, 1e-9))[:, None]


def _damped_step(jacobian: Array, error: Array, damping: float) -> Array:
    """Returns dq = J^T (J J^T + damping^2 I)^-1 error, for (B, D, J) and (B, D)."""
    gram = jacobian @ jacobian.transpose(0, 2, 1)
    gram[:, np.arange(gram.shape[1]), np.arange(gram.shape[1])] += damping**2
    return (jacobian.transpose(0, 2, 1) @ np.linalg.solve(gram, error[:, :, None]))[:, :, 0]


TABLE_POSES = 200_000


class CompiledArm(BatchArm):
    """As `BatchArm`, in a tenth of the time; its results differ by rounding."""

    @cached_property
    def _arm(self) -> tuple[Array, Array]:
        """Joints (J, 13) and limits (2, J), as the kernel takes them."""
        return chain_of(self.robot), np.stack(self.limits_rad)

    @property
    def starts(self) -> PoseTable:
        """Arm poses by the position of the end-effector."""
        return pose_table(self.robot)

    def solve(
        self, qpos: Array, targets_m: Array, config: IkConfig, tool: Tool | None = None
    ) -> tuple[Array, NDArray[np.bool_]]:
        """See `BatchArm`."""
        qpos, reached = np.array(qpos, dtype=np.float64), np.zeros(len(qpos))
        point_m, up, rest = np.zeros(3), np.zeros(3), (0.0, 0.0, 0.0)
        if tool is not None:
            point_m, up = self._turn @ tool.point_m, self._turn @ tool.up
            rest = tool.tilt_weight_m, tool.tilt_rad, tool.step_rad
        settings = np.array((config.steps, config.damping, config.step_m, config.tolerance_m))
        row = np.array((*(self._wrist_from_ee_m + point_m), *up, *rest))
        targets_m = np.ascontiguousarray(targets_m)
        ik_kernel().solve(*self._arm, row, qpos, targets_m, settings, reached)
        return qpos, reached > 0.0

    def track_pose(
        self, qpos: Array, arm_from_ee: Array, steps: int, turn_weight_m: float
    ) -> Array:
        """See `BatchArm`."""
        weights_m = np.full(1, turn_weight_m)
        return self.track_poses(qpos[None], arm_from_ee[None], steps, weights_m)[0]

    def track_poses(
        self, qpos: Array, arm_from_ee: Array, steps: int, turn_weights_m: Array
    ) -> Array:
        """See `BatchArm`."""
        arm_from_wrist = arm_from_ee.copy()
        arm_from_wrist[:, :3, :3] = arm_from_ee[:, :3, :3] @ self._turn.T
        qpos, goals = np.array(qpos, dtype=np.float64), rows_of(arm_from_wrist)
        ee_m, weights_m = self._wrist_from_ee_m, np.ascontiguousarray(turn_weights_m)
        ik_kernel().track(*self._arm, ee_m, qpos, goals, weights_m, steps)
        return qpos

    def positions_m(self, qpos: Array) -> Array:
        """See `BatchArm`."""
        positions_m = np.empty((len(qpos), 3))
        ik_kernel().positions(self._arm[0], self._wrist_from_ee_m, qpos, positions_m)
        return positions_m


class PoseTable:
    """Random arm poses, found by the position of the end-effector."""

    def __init__(self, arm: CompiledArm, count: int = TABLE_POSES) -> None:
        # A fixed seed, as the results of planning depend on the table.
        self._poses = arm.random(np.random.default_rng(0), count)
        self._tree = KDTree(arm.positions_m(self._poses))

    def near(
        self, points_m: Array, count: int, rng: np.random.Generator
    ) -> tuple[Array, NDArray[np.int64]]:
        """Returns about half of the `count` poses nearest to each point, chosen at random.

        Args:
            points_m: (P, 3) in the arm's root frame.
            count: Number of poses a point.
            rng: Chooses.

        Returns:
            The poses (B, J), and the index of the point of each (B,).
        """
        found = self._tree.query(points_m, k=count)[1].ravel()
        chosen = np.flatnonzero(rng.random(len(found)) < 0.5)
        return self._poses[found[chosen]], chosen // count


@cache
def pose_table(robot: RobotSpec) -> PoseTable:
    """Returns the table; made once a process, in 0.2 s."""
    return PoseTable(CompiledArm(robot))
