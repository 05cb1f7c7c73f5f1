"""The paper's control of Fetch in one ManiSkill controller (S E.3, F.6, H.2).

Action layout: arm and gripper (1), where the arm is controlled, then base (2), where it is.

====================  ===============================================================
arm mode              meaning of the arm's entries
====================  ===============================================================
``ee`` (3)            end-effector displacement in the base frame, [-1, 1] -> 1.5 cm
``joint_delta`` (7)   joint displacement, [-1, 1] -> 0.0125 rad
``joint_target`` (7)  joint position targets [rad], for planners
``joint_state`` (7)   joint positions [rad], set at once: the perfect controller (S I.1)
====================  ===============================================================

With ``_base`` added the base moves as well; in ``base`` and ``base_discrete`` only the base moves.
Gripper >= 0 asks to grasp, < 0 to release. Base: forward and turning velocity, [-1, 1] times the
largest speeds; both next to zero is the stop action. ``base_discrete`` is one of the paper's 20
cells of these two (`BASE_CELLS`). With ``_pose`` added to an absolute arm mode, the base's three
entries are its pose in the world, x, y [m] and yaw [rad], set at once; the present pose is to stay.

Entries are clipped to their range, and a yaw is taken within a turn; an action that is not finite
is refused. What is set is at rest there, and its drives hold it; how far it jumps is not limited,
and nothing on the way is touched, so planners go in steps of a few centimetres.
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

from hab_tasks.constants import EE_STEP_M, JOINT_STEP_RAD
from hab_tasks.errors import ActionError
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
from hab_tasks.robots.fetch_spec import (
    ARM_JOINTS,
    ARM_LOWER_RAD,
    ARM_UPPER_RAD,
    BASE_ANGULAR_SPEED_RAD_S,
    BASE_JOINTS,
    BASE_LINEAR_SPEED_M_S,
    EE_LOWER_M,
    EE_UPPER_M,
    LOCKED_QPOS,
)
from hab_tasks.robots.joint_setter import JointSetter
from hab_tasks.robots.kinematics import ArmKinematics

Array = NDArray[Any]

_EE_LOWER, _EE_UPPER = np.array(EE_LOWER_M), np.array(EE_UPPER_M)
_ARM_LOWER, _ARM_UPPER = np.array(ARM_LOWER_RAD), np.array(ARM_UPPER_RAD)


PUSH_APART_M_S = 1.0
"""A robot that is set into something is pushed apart from it no faster: without a limit, an arm set
5 cm deep into a wall was thrown out at 50 rad/s."""


class HabController(BaseController):
    """Turns one flat action into drive targets; keeps the commanded arm pose and gripper value.

    Attributes:
        arm_target_rad: (N, 7) commanded arm pose.
        gripper: (N,) last gripper entry; the environment hands it to the snap grasp.
        base_target: (N, 3) commanded x, y [m] and yaw [rad], where the action gives a base pose.
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
        self._arm_index = torch.tensor([index[name] for name in ARM_JOINTS], device=self.device)
        self._base_index = torch.tensor([index[name] for name in BASE_JOINTS], device=self.device)
        active = self.articulation.active_joints
        self._arm_joints = [active[index[name]] for name in ARM_JOINTS]
        self._base_joints = [active[index[name]] for name in BASE_JOINTS]
        self._on_cpu = not self.scene.gpu_sim_enabled
        self._cpu_drives = [joint._objs[0].set_drive_target for joint in self._arm_joints]
        self._cpu_base_drives = [j._objs[0].set_drive_velocity_target for j in self._base_joints]
        self._arm_setter = JointSetter(self.articulation, self._arm_joints, self._arm_index)
        self._base_setter = JointSetter(self.articulation, self._base_joints, self._base_index)
        self._cpu_robot, self._cpu_yaw = self.articulation._objs[0], int(self._base_index[2])

    def set_drive_property(self) -> None:
        """Sets every joint's drive. A base that the action does not drive is held in place."""
        c = self.config
        if c.sets_joints:
            for link in self.articulation.links:
                for body in link._objs:
                    body.set_max_depenetration_velocity(PUSH_APART_M_S)
        for joint in self.articulation.active_joints:
            if joint.name in ARM_JOINTS:
                joint.set_drive_properties(
                    c.arm_stiffness, c.arm_damping, c.arm_force_n, mode="force"
                )
                joint.set_friction(0.1)
            elif joint.name in BASE_JOINTS:
                stiffness = c.base_stiffness if c.base in ("still", "pose") else 0.0
                joint.set_drive_properties(stiffness, c.base_damping, c.base_force_n, mode="force")
            else:
                joint.set_drive_properties(c.lock_stiffness, c.lock_damping, 1000.0, mode="force")

    def reset(self) -> None:
        """Makes the present pose the commanded one, for the rows that are being reset."""
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
            if joint.name in LOCKED_QPOS:
                targets[:, i] = LOCKED_QPOS[joint.name]
        self.articulation.set_joint_drive_targets(targets, self.articulation.active_joints)
        zeros = torch.zeros_like(qpos)
        self.articulation.set_joint_drive_velocity_targets(zeros, self.articulation.active_joints)

    def set_action(self, action: Tensor) -> None:
        """Sets drive targets from an action (N, A), or from N cells.

        Raises:
            ActionError: Wrong shape, or an entry that is not finite or no cell.
        """
        action = self.check(action)
        if self._on_cpu:
            self._set_row(action[0].numpy())
        else:
            self._set_batch(torch.clamp(action, self._low, self._high))

    def check(self, action: Tensor) -> Tensor:
        """Returns the entries (N, A) of an action, which may be N cells, or refuses it.

        Raises:
            ActionError: Wrong shape, or an entry that is not finite or no cell.
        """
        if self.config.base == "discrete":
            action = self._velocities(action)
        expected = (self.scene.num_envs, len(self._low))
        if tuple(action.shape) != expected:
            raise ActionError(f"Action of shape {tuple(action.shape)}; expected {expected}.")
        # The sum is finite only if every entry is, and takes one operation instead of three.
        if not math.isfinite(float(action.sum(dtype=torch.float64))):
            raise ActionError(f"Action holds a value that is not finite: {action.tolist()}.")
        if self.config.base == "pose":
            action = torch.cat((action[:, :-1], within_a_turn(action[:, -1:])), dim=1)
        return action

    @property
    def action_size(self) -> int:
        """How many numbers an action of one row is: its entries, or one cell."""
        return 1 if self.config.base == "discrete" else self.config.size

    def idle_action(self, holding: Tensor) -> Tensor:
        """Returns the action (N, A) that moves nothing and keeps what is held.

        Args:
            holding: (N,) whether the hand holds anything.
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
        """Returns the base's entries (N, 2) of cells (N,) or (N, 1)."""
        flat = cells.reshape(-1)
        count = self.scene.num_envs
        if len(flat) != count or cells.dim() > 2:
            raise ActionError(f"Action of shape {tuple(cells.shape)}; expected ({count},).")
        index = flat.to(torch.long)
        if bool((index != flat).any()) or not bool(
            ((index >= 0) & (index < len(BASE_CELLS))).all()
        ):
            last = len(BASE_CELLS) - 1
            raise ActionError(f"Action {flat.tolist()}; each is one of the cells 0 to {last}.")
        return self._cells[index]

    def _set_row(self, action: Array) -> None:
        """The one row of the CPU simulation, in plain numbers: a third of the tensors' time."""
        action = np.minimum(np.maximum(action, self._cpu_low), self._cpu_high)
        size = ARM_SIZE[self.config.arm]
        if size:
            target = self.arm_target_rad[0].numpy().astype(np.float64)
            qpos = self._arm_target(target, action[:size])
            self.arm_target_rad = torch.from_numpy(qpos.astype(np.float32))[None]
            self.gripper = torch.from_numpy(action[size : size + 1])
            if self.config.arm == "joint_state":
                self._arm_setter.set_row(qpos.tolist())
            else:
                for drive, value in zip(self._cpu_drives, qpos.tolist(), strict=True):
                    drive(value)
        if self.config.base == "pose":
            self.base_target = torch.from_numpy(action[-3:])[None]
            self._base_setter.set_row(action[-3:].tolist())
        elif self.config.base != "still":
            self._drive_row(*action[-2:].tolist())

    def _drive_row(self, linear: float, angular: float) -> None:
        """Drives the base of the one row."""
        still = abs(linear) <= STOP_SHARE and abs(angular) <= STOP_SHARE
        self.stopped = np.array([still])
        yaw = float(self._cpu_robot.qpos[self._cpu_yaw])
        forward = BASE_LINEAR_SPEED_M_S * linear
        x, y, turning = self._cpu_base_drives
        x(forward * math.cos(yaw))
        y(forward * math.sin(yaw))
        turning(BASE_ANGULAR_SPEED_RAD_S * angular)

    def _set_batch(self, action: Tensor) -> None:
        size = ARM_SIZE[self.config.arm]
        if size:
            self.arm_target_rad = self._batch_arm_target(action[:, :size])
            self.gripper = action[:, size]
            if self.config.arm == "joint_state":
                self._arm_setter.set_batch(self.arm_target_rad)
            else:
                self._drive_arm()
        if self.config.base == "pose":
            self.base_target = action[:, -3:]
            self._base_setter.set_batch(self.base_target)
        elif self.config.base != "still":
            self.stopped = (action[:, -2:].abs() <= STOP_SHARE).all(dim=1)
            self._drive_base(action[:, -2:])

    def get_state(self) -> dict[str, Tensor]:
        """Returns the commanded arm pose (N, 7), gripper (N,) and base pose (N, 3), if there is."""
        state = {"arm_target_rad": self.arm_target_rad.clone(), "gripper": self.gripper.clone()}
        if self.config.base == "pose":
            state["base_target"] = self.base_target.clone()
        return state

    def set_state(self, state: dict[str, Tensor], rows: Tensor | None = None) -> None:
        """Restores what `get_state` returned, for `rows` (R,) or for all."""
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
        """Returns the arm pose (7,) [rad] that an action's arm entries ask for."""
        if self.config.arm in ABSOLUTE_ARM:
            return arm
        if self.config.arm == "joint_delta":
            moved = qpos + JOINT_STEP_RAD * arm
            return np.minimum(np.maximum(moved, _ARM_LOWER), _ARM_UPPER)
        return self._kinematics.move(qpos, EE_STEP_M * arm, _EE_LOWER, _EE_UPPER)

    def _batch_arm_target(self, arm: Tensor) -> Tensor:
        """`_arm_target` for (N, ...) rows on any device."""
        if self.config.arm in ABSOLUTE_ARM:
            return arm
        if self.config.arm == "joint_delta":
            lower, upper = self._limits()
            moved = self.arm_target_rad + JOINT_STEP_RAD * arm
            return torch.minimum(torch.maximum(moved, lower), upper)
        position, _ = self._kinematics.batch_position_and_jacobian(self.arm_target_rad)
        low = torch.tensor(EE_LOWER_M, device=self.device)
        high = torch.tensor(EE_UPPER_M, device=self.device)
        goal = torch.minimum(torch.maximum(position + EE_STEP_M * arm, low), high)
        return self._kinematics.batch_displace(self.arm_target_rad, goal)

    def _limits(self) -> tuple[Tensor, Tensor]:
        return (
            torch.tensor(ARM_LOWER_RAD, device=self.device),
            torch.tensor(ARM_UPPER_RAD, device=self.device),
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
        forward = BASE_LINEAR_SPEED_M_S * base[:, 0]
        turning = BASE_ANGULAR_SPEED_RAD_S * base[:, 1]
        speeds = torch.stack((forward * torch.cos(yaw), forward * torch.sin(yaw), turning), dim=1)
        self.articulation.set_joint_drive_velocity_targets(
            speeds, self._base_joints, self._base_index
        )


@dataclass
class HabControllerConfig(ControllerConfig):
    """Arm mode, base mode, and the drives' gains (see docs/deviations.md)."""

    joint_names: list[str] = field(default_factory=lambda: list(ARM_JOINTS + BASE_JOINTS))
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
        """Whether actions put joints somewhere at once instead of driving them."""
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
