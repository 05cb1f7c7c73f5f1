"""Sets robot joint states directly: the perfect controller, and base poses.

A planner's arm can be set to each waypoint of its path instead of being driven there ("perfect
controller", S D and I.1), and a base pose can be set instead of navigating.
"""

from __future__ import annotations

from collections.abc import Sequence

from mani_skill.utils.structs import Articulation, ArticulationJoint
from torch import Tensor

from hab_tasks.simulator import sapien_object


class JointSetter:
    """Sets the same robot joints in every row; other joints are unaffected."""

    def __init__(
        self, robot: Articulation, joints: Sequence[ArticulationJoint], index: Tensor
    ) -> None:
        """Sets `joints`, which have the indices `index` (J,) among the active joints."""
        self._robot, self._joints, self._index = robot, list(joints), index
        self._cpu_robot, self._columns = sapien_object(robot), index.tolist()
        self._cpu_drives = [sapien_object(joint).set_drive_target for joint in self._joints]

    def set_row(self, values: list[float]) -> None:
        """Sets the joints to `values` (J,), at rest; CPU simulation."""
        positions, speeds = self._cpu_robot.qpos, self._cpu_robot.qvel
        positions[self._columns], speeds[self._columns] = values, 0.0
        self._cpu_robot.set_qpos(positions)
        self._cpu_robot.set_qvel(speeds)
        for drive, value in zip(self._cpu_drives, values, strict=True):
            drive(value)

    def set_batch(self, values: Tensor) -> None:
        """Sets the joints to `values` (N, J), at rest; `SnapGrasp.carry` writes them to the GPU."""
        positions, speeds = self._robot.get_qpos().clone(), self._robot.get_qvel().clone()
        positions[:, self._index], speeds[:, self._index] = values, 0.0
        self._robot.set_qpos(positions)
        self._robot.set_qvel(speeds)
        self._robot.set_joint_drive_targets(values, self._joints, self._index)
