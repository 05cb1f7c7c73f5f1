"""Puts joints of the robot somewhere at once: the perfect controller, and a base that is carried.

A planner's arm can be set to each point of its path instead of being driven there ("perfect
controller", S D and I.1), and a base can be set down elsewhere instead of navigating.
"""

from __future__ import annotations

from collections.abc import Sequence

from mani_skill.utils.structs import Articulation, ArticulationJoint
from torch import Tensor


class JointSetter:
    """Sets the same joints of the robot in every row; the other joints go on as they were."""

    def __init__(
        self, robot: Articulation, joints: Sequence[ArticulationJoint], index: Tensor
    ) -> None:
        """Sets `joints`, the active ones of `index` (J,)."""
        self._robot, self._joints, self._index = robot, list(joints), index
        self._cpu_robot, self._columns = robot._objs[0], index.tolist()
        self._cpu_drives = [joint._objs[0].set_drive_target for joint in self._joints]

    def set_row(self, values: list[float]) -> None:
        """Puts the joints of the one row of the CPU simulation at `values` (J,), at rest."""
        positions, speeds = self._cpu_robot.qpos, self._cpu_robot.qvel
        positions[self._columns], speeds[self._columns] = values, 0.0
        self._cpu_robot.set_qpos(positions)
        self._cpu_robot.set_qvel(speeds)
        for drive, value in zip(self._cpu_drives, values, strict=True):
            drive(value)

    def set_batch(self, values: Tensor) -> None:
        """Puts the joints at `values` (N, J), at rest; the GPU is told by `SnapGrasp.carry`."""
        positions, speeds = self._robot.get_qpos().clone(), self._robot.get_qvel().clone()
        positions[:, self._index], speeds[:, self._index] = values, 0.0
        self._robot.set_qpos(positions)
        self._robot.set_qvel(speeds)
        self._robot.set_joint_drive_targets(values, self._joints, self._index)
