"""The paper's control of Fetch in one ManiSkill controller (S E.3, F.6, H.2).

Action layout: arm and gripper (1) if the arm is controlled, then base (2) if the base is.

====================  ===============================================================
arm mode              meaning of the arm's entries
====================  ===============================================================
``ee`` (3)            end-effector displacement in the base frame, [-1, 1] -> 1.5 cm
``joint_delta`` (7)   joint displacement, [-1, 1] -> 0.0125 rad
``joint_target`` (7)  joint position targets [rad], for planners
``joint_state`` (7)   joint positions [rad], set directly: the perfect controller (S I.1)
====================  ===============================================================

With the suffix ``_base`` the base moves as well; in ``base`` and ``base_discrete`` only the base
moves. Gripper >= 0 grasps, < 0 releases. Base: forward and turning velocity, [-1, 1] times the
maximum speeds; both close to zero is the stop action. ``base_discrete`` is one of the paper's 20
cells of these two (`BASE_CELLS`). With the suffix ``_pose`` on an absolute arm mode, the base has
three entries, its pose in the world: x, y [m] and yaw [rad], set directly; the current pose keeps
the base in place.

Entries are clipped to their range, and yaw is wrapped; non-finite actions raise an error. An action
changes absolute joint entries by at most 0.08 rad, and a base pose by what the base drives in that
time. Joints that are set directly get there in one share a physics step, at rest and held by their
drives; where that would push the robot more than 1 cm into something, they stay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from mani_skill.agents.controllers.base_controller import BaseController, ControllerConfig
from numpy.typing import NDArray
from torch import Tensor

from hab_tasks.constants import EE_STEP_M, JOINT_STEP_RAD, TARGET_STEP_RAD
from hab_tasks.errors import ActionError
from hab_tasks.robots.arm_commands import commanded_arm
from hab_tasks.robots.control_modes import (
    ABSOLUTE_ARM,
    ARM_SIZE,
    BASE_CELLS,
    STOP_CELL,
    STOP_SHARE,
    ArmMode,
    BaseMode,
    Cells,
    action_bounds,
    action_size,
    within_a_turn,
)
from hab_tasks.robots.joint_setter import JointSetter, base_way
from hab_tasks.robots.kinematics import ArmKinematics
from hab_tasks.robots.robot import ROBOT
from hab_tasks.simulator import sapien_object, sapien_objects

Array = NDArray[Any]

_CELLS = np.array(BASE_CELLS, dtype=np.float32)


PUSH_APART_M_S = 1.0
"""Maximum depenetration velocity of the robot: without a limit, an arm set 5 cm deep into a wall
was ejected at 50 rad/s."""


class HabController(BaseController):
    """Converts a flat action to drive targets; keeps the commanded arm pose and gripper value.

    Attributes:
        arm_target_rad: (N, 7) commanded arm pose.
        gripper: (N,) last gripper entry; the environment passes it to the snap grasp.
        base_target: (N, 3) commanded x, y [m] and yaw [rad], in modes with a base pose.
        stopped: (N,) whether the last action was the stop action; numpy on the CPU.
    """

    config: HabControllerConfig
    sets_target_qpos = True
    sets_target_qvel = True

    def _initialize_action_space(self) -> None:
        low, high = action_bounds(self.config.arm, self.config.base)
        self.single_action_space = spaces.Box(low, high, dtype=np.float32)
        if self.config.base == "discrete":
            self.single_action_space = Cells(len(BASE_CELLS))
        self._cpu_low, self._cpu_high = low, high
        self._low = torch.as_tensor(low, device=self.device)
        self._high = torch.as_tensor(high, device=self.device)
        self._kinematics = ArmKinematics()
        count = self.scene.num_envs
        self.arm_target_rad = torch.zeros(count, 7, device=self.device)
        self.base_target = torch.zeros(count, 3, device=self.device)
        self.gripper = torch.full((count,), -1.0, device=self.device)
        self.stopped = np.zeros(count, dtype=bool)
        if self.scene.gpu_sim_enabled:
            self.stopped = torch.zeros(count, dtype=torch.bool, device=self.device)
        self._cells = torch.tensor(BASE_CELLS, device=self.device)
        index = {joint.name: i for i, joint in enumerate(self.articulation.active_joints)}
        self._arm_index = torch.tensor(
            [index[name] for name in ROBOT.arm_joints], device=self.device
        )
        self._base_index = torch.tensor(
            [index[name] for name in ROBOT.base_joints], device=self.device
        )
        active = self.articulation.active_joints
        self._arm_joints = [active[index[name]] for name in ROBOT.arm_joints]
        self._base_joints = [active[index[name]] for name in ROBOT.base_joints]
        self._on_cpu = not self.scene.gpu_sim_enabled
        self._cpu_drives = [sapien_object(joint).set_drive_target for joint in self._arm_joints]
        self._cpu_base_drives = [
            sapien_object(j).set_drive_velocity_target for j in self._base_joints
        ]
        self._arm_setter = JointSetter(self.articulation, self._arm_joints, self._arm_index)
        self._base_setter = JointSetter(self.articulation, self._base_joints, self._base_index)
        self._cpu_robot, self._cpu_yaw = sapien_object(self.articulation), int(self._base_index[2])

    def set_drive_property(self) -> None:
        """Sets all joint drives. A base that actions do not control is held in place."""
        c = self.config
        if c.sets_joints:
            for link in self.articulation.links:
                for body in sapien_objects(link):
                    body.set_max_depenetration_velocity(PUSH_APART_M_S)
        for joint in self.articulation.active_joints:
            if joint.name in ROBOT.arm_joints:
                joint.set_drive_properties(
                    c.arm_stiffness, c.arm_damping, c.arm_force_n, mode="force"
                )
                joint.set_friction(0.1)
            elif joint.name in ROBOT.base_joints:
                stiffness = c.base_stiffness if c.base in ("still", "pose") else 0.0
                joint.set_drive_properties(stiffness, c.base_damping, c.base_force_n, mode="force")
            else:
                joint.set_drive_properties(c.lock_stiffness, c.lock_damping, 1000.0, mode="force")

    def reset(self) -> None:
        """Sets the commanded pose of the rows being reset to the current pose."""
        qpos = self.articulation.get_qpos()
        rows = self.scene._reset_mask
        self.arm_target_rad = torch.where(
            rows[:, None], qpos[:, self._arm_index], self.arm_target_rad
        )
        base = qpos[:, self._base_index]
        base = torch.cat((base[:, :2], within_a_turn(base[:, 2:])), dim=1)
        self.base_target = torch.where(rows[:, None], base, self.base_target)
        self.gripper = torch.where(rows, torch.full_like(self.gripper, -1.0), self.gripper)
        targets = qpos.clone()
        for i, joint in enumerate(self.articulation.active_joints):
            if joint.name in ROBOT.locked_qpos:
                targets[:, i] = ROBOT.locked_qpos[joint.name]
        self.articulation.set_joint_drive_targets(targets, self.articulation.active_joints)
        zeros = torch.zeros_like(qpos)
        self.articulation.set_joint_drive_velocity_targets(zeros, self.articulation.active_joints)

    def set_action(self, action: Tensor) -> None:
        """Sets drive targets from an action (N, A), or from N cells.

        Raises:
            ActionError: Wrong shape, a non-finite entry, or an invalid cell.
        """
        action = self.check(action)
        if self._on_cpu:
            self._set_entries(action[0].numpy())
        else:
            self._set_batch(torch.clamp(action, self._low, self._high))

    def check(self, action: Tensor) -> Tensor:
        """Validates an action, which may be N cells; returns its entries (N, A).

        Raises:
            ActionError: Wrong shape, a non-finite entry, or an invalid cell.
        """
        if self.config.base == "discrete":
            action = self._velocities(action)
        expected = (self.scene.num_envs, len(self._low))
        if tuple(action.shape) != expected:
            raise ActionError(f"Action of shape {tuple(action.shape)}; expected {expected}.")
        # The sum is finite only if every entry is, and takes one operation instead of three.
        if not math.isfinite(float(action.sum(dtype=torch.float64))):
            raise ActionError(f"Action has a non-finite value: {action.tolist()}.")
        if self.config.base == "pose":
            action = torch.cat((action[:, :-1], within_a_turn(action[:, -1:])), dim=1)
        return action

    @property
    def action_size(self) -> int:
        """Number of values of one row's action: its entries, or one cell."""
        return 1 if self.config.base == "discrete" else self.config.size

    def idle_action(self, holding: Tensor) -> Tensor:
        """Returns the action (N, A) that stands still and keeps the grasp.

        Args:
            holding: (N,) whether the hand holds an object or handle.
        """
        count = len(holding)
        if self.config.base == "discrete":
            return torch.full((count, 1), float(STOP_CELL), device=self.device)
        action = torch.zeros(count, len(self._low), device=self.device)
        size = ARM_SIZE[self.config.arm]
        if self.config.arm in ABSOLUTE_ARM:
            action[:, :size] = self.arm_target_rad
        if self.config.base == "pose":
            action[:, -3:] = self.base_target
        if size:
            action[:, size] = torch.where(holding, 1.0, -1.0)
        return action

    def _velocities(self, cells: Tensor) -> Tensor:
        """Returns the base entries (N, 2) of cells (N,) or (N, 1)."""
        flat = cells.reshape(-1)
        count = self.scene.num_envs
        if len(flat) != count or cells.dim() > 2:
            raise ActionError(f"Action of shape {tuple(cells.shape)}; expected ({count},).")
        index = flat.to(torch.long)
        if bool((index != flat).any()) or not bool(
            ((index >= 0) & (index < len(BASE_CELLS))).all()
        ):
            last = len(BASE_CELLS) - 1
            raise ActionError(f"Action {flat.tolist()}; valid cells are 0 to {last}.")
        return self._cells[index]

    def set_row(self, action: Array) -> None:
        """`set_action` for a valid action (A,) or cell (1,) in the CPU simulation."""
        if self.config.base == "discrete":
            action = _CELLS[int(action[0])]
        elif self.config.base == "pose":
            action = np.concatenate((action[:-1], within_a_turn(action[-1:])))
        self._set_entries(action)

    def _set_entries(self, action: Array) -> None:
        """Sets the targets of one row in plain numbers, a third of the time of tensors."""
        action = np.minimum(np.maximum(action, self._cpu_low), self._cpu_high)
        size = ARM_SIZE[self.config.arm]
        if size:
            self.gripper = torch.from_numpy(action[size : size + 1])
            if self.config.arm == "joint_state":
                qpos = self._arm_setter.values().astype(np.float64)
                self._arm_setter.begin(self._arm_target(qpos, action[:size]) - qpos)
            else:
                target = self.arm_target_rad[0].numpy().astype(np.float64)
                qpos = self._arm_target(target, action[:size])
                self.arm_target_rad = torch.from_numpy(qpos.astype(np.float32))[None]
                for drive, value in zip(self._cpu_drives, qpos.tolist(), strict=True):
                    drive(value)
        if self.config.base == "pose":
            self._base_setter.begin(base_way(self._base_setter.values(), action[-3:]))
        elif self.config.base != "still":
            self._drive_row(*action[-2:].tolist())

    def move_joints(self, share: float) -> None:
        """Sets the joints of modes that set them after a share of the action; CPU simulation."""
        if self.config.arm == "joint_state":
            self._arm_setter.move(share)
            self.arm_target_rad = torch.from_numpy(self._arm_setter.values())[None]
        if self.config.base == "pose":
            self._base_setter.move(share)
            base = self._base_setter.values()
            base[2] = within_a_turn(base[2])
            self.base_target = torch.from_numpy(base)[None]

    def _drive_row(self, linear: float, angular: float) -> None:
        """Drives the base in the CPU simulation."""
        still = abs(linear) <= STOP_SHARE and abs(angular) <= STOP_SHARE
        self.stopped = np.array([still])
        yaw = float(self._cpu_robot.qpos[self._cpu_yaw])
        forward = ROBOT.base_linear_speed_m_s * linear
        x, y, turning = self._cpu_base_drives
        x(forward * math.cos(yaw))
        y(forward * math.sin(yaw))
        turning(ROBOT.base_angular_speed_rad_s * angular)

    def _set_batch(self, action: Tensor) -> None:
        if self.config.sets_joints:
            raise NotImplementedError("joint_state and ..._pose need the CPU simulation")
        size = ARM_SIZE[self.config.arm]
        if size:
            self.arm_target_rad = self._batch_arm_target(action[:, :size])
            self.gripper = action[:, size]
            self._drive_arm()
        if self.config.base != "still":
            self.stopped = (action[:, -2:].abs() <= STOP_SHARE).all(dim=1)
            self._drive_base(action[:, -2:])

    def get_state(self) -> dict[str, Tensor]:
        """Returns the commanded arm pose (N, 7), gripper (N,) and, if any, base pose (N, 3)."""
        state = {"arm_target_rad": self.arm_target_rad.clone(), "gripper": self.gripper.clone()}
        if self.config.base == "pose":
            state["base_target"] = self.base_target.clone()
        return state

    def set_state(self, state: dict[str, Tensor], rows: Tensor | None = None) -> None:
        """Restores a state of `get_state` for `rows` (R,) or for all."""
        chosen = slice(None) if rows is None else rows
        self.arm_target_rad, self.gripper = self.arm_target_rad.clone(), self.gripper.clone()
        self.arm_target_rad[chosen] = state["arm_target_rad"]
        self.gripper[chosen] = state["gripper"]
        self._drive_arm()
        if self.config.base == "pose":
            self.base_target = self.base_target.clone()
            self.base_target[chosen] = state["base_target"]
            self.articulation.set_joint_drive_targets(
                self.base_target, self._base_joints, self._base_index
            )

    def _arm_target(self, qpos: Array, arm: Array) -> Array:
        """Returns the commanded arm pose (7,) [rad] of an action's arm entries."""
        return commanded_arm(self.config.arm, qpos, arm, self._kinematics)

    def _batch_arm_target(self, arm: Tensor) -> Tensor:
        """`_arm_target` for (N, ...) rows on any device."""
        if self.config.arm in ABSOLUTE_ARM:
            low, high = (self.arm_target_rad + way for way in (-TARGET_STEP_RAD, TARGET_STEP_RAD))
            return torch.minimum(torch.maximum(arm, low), high)
        if self.config.arm == "joint_delta":
            lower, upper = self._limits()
            moved = self.arm_target_rad + JOINT_STEP_RAD * arm
            return torch.minimum(torch.maximum(moved, lower), upper)
        position, _ = self._kinematics.batch_position_and_jacobian(self.arm_target_rad)
        low = torch.tensor(ROBOT.ee_lower_m, device=self.device)
        high = torch.tensor(ROBOT.ee_upper_m, device=self.device)
        goal = torch.minimum(torch.maximum(position + EE_STEP_M * arm, low), high)
        return self._kinematics.batch_displace(self.arm_target_rad, goal)

    def _limits(self) -> tuple[Tensor, Tensor]:
        return (
            torch.tensor(ROBOT.arm_lower_rad, device=self.device),
            torch.tensor(ROBOT.arm_upper_rad, device=self.device),
        )

    def _drive_arm(self) -> None:
        if self._on_cpu:
            values = self.arm_target_rad[0].tolist()
            for drive, value in zip(self._cpu_drives, values, strict=True):
                drive(value)
        else:
            self.articulation.set_joint_drive_targets(
                self.arm_target_rad, self._arm_joints, self._arm_index
            )

    def _drive_base(self, base: Tensor) -> None:
        yaw = self.articulation.get_qpos()[:, self._base_index[2]]
        forward = ROBOT.base_linear_speed_m_s * base[:, 0]
        turning = ROBOT.base_angular_speed_rad_s * base[:, 1]
        speeds = torch.stack((forward * torch.cos(yaw), forward * torch.sin(yaw), turning), dim=1)
        self.articulation.set_joint_drive_velocity_targets(
            speeds, self._base_joints, self._base_index
        )


@dataclass
class HabControllerConfig(ControllerConfig):
    """Arm mode, base mode, and drive gains (see docs/deviations.md)."""

    joint_names: list[str] = field(
        default_factory=lambda: list(ROBOT.arm_joints + ROBOT.base_joints)
    )
    arm: ArmMode = "ee"
    base: BaseMode = "still"
    arm_stiffness: float = 3e3
    arm_damping: float = 2e2
    arm_force_n: float = 150.0
    base_stiffness: float = 1e6
    base_damping: float = 1e4
    base_force_n: float = 1e4
    lock_stiffness: float = 1e4
    lock_damping: float = 1e3
    controller_cls: Any = HabController

    @property
    def size(self) -> int:
        """Number of entries of an action: arm and gripper, base."""
        return action_size(self.arm, self.base)

    @property
    def sets_joints(self) -> bool:
        """Whether actions set joint states directly instead of driving the joints."""
        return self.arm == "joint_state" or self.base == "pose"


def control_configs() -> dict[str, HabControllerConfig]:
    """Returns every control mode of `hab_fetch` by name."""
    modes: dict[str, HabControllerConfig] = {}
    for arm in ("ee", "joint_delta", "joint_target", "joint_state"):
        modes[arm] = HabControllerConfig(arm=arm, base="still")
        modes[f"{arm}_base"] = HabControllerConfig(arm=arm, base="velocity")
    for arm in ABSOLUTE_ARM:
        modes[f"{arm}_pose"] = HabControllerConfig(arm=arm, base="pose")
    modes["base"] = HabControllerConfig(arm="still", base="velocity")
    modes["base_discrete"] = HabControllerConfig(arm="still", base="discrete")
    return modes
