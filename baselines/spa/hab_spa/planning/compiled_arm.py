"""The arm's kinematics, compiled, with a table of arm poses as starts of inverse kinematics."""

from __future__ import annotations

from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from hab_spa.planning.batch import chain_of, ik_kernel, rows_of
from hab_spa.planning.ik import BatchArm, IkConfig, Tool
from hab_spa.shapes import Array
from hab_tasks.robots.spec import RobotSpec

TABLE_POSES = 200_000


class CompiledArm(BatchArm):
    """As `BatchArm`, in a tenth of the time; its results differ by rounding."""

    @cached_property
    def _arm(self) -> tuple[Array, Array]:
        """Joints (7, 13) and limits (2, 7), as the kernel takes them."""
        return chain_of(self._model), np.stack(self.limits_rad)

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
            point_m, up = tool.point_m, tool.up
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
        qpos, goals = np.array(qpos, dtype=np.float64), rows_of(arm_from_ee)
        ee_m, weights_m = self._wrist_from_ee_m, np.ascontiguousarray(turn_weights_m)
        ik_kernel().track(*self._arm, ee_m, qpos, goals, weights_m, steps)
        return qpos

    def positions_m(self, qpos: Array) -> Array:
        """Returns the end-effector's positions (B, 3) at arm poses (B, 7)."""
        positions_m = np.empty((len(qpos), 3))
        ik_kernel().positions(self._arm[0], self._wrist_from_ee_m, qpos, positions_m)
        return positions_m


class PoseTable:
    """Random arm poses, found by the position of the end-effector."""

    def __init__(self, arm: CompiledArm, count: int = TABLE_POSES) -> None:
        self._poses = np.random.default_rng(0).uniform(*arm.limits_rad, (count, 7))
        self._tree = KDTree(arm.positions_m(self._poses))

    def near(self, points_m: Array, count: int) -> tuple[Array, Array]:
        """Returns the poses nearest to points (P, 3) in the arm's root frame.

        Returns:
            `count` poses a point (P * count, 7), and the point of each (P * count, 3).
        """
        _, found = self._tree.query(points_m, k=count)
        return self._poses[found.ravel()], np.repeat(points_m, count, axis=0)


@cache
def pose_table(robot: RobotSpec) -> PoseTable:
    """Returns the table; made once a process, in 0.2 s."""
    return PoseTable(CompiledArm(robot))
