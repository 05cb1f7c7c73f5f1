"""The paper's control of a robot in one ManiSkill controller (S E.3, F.6, H.2).

Action layout: arm and gripper (1) if the arm is controlled, then base (2) if the base is.

====================  ===============================================================
arm mode              meaning of the arm's entries
====================  ===============================================================
``ee`` (3)            end-effector displacement in the base frame, [-1, 1] -> 1.5 cm
``joint_delta`` (J)   joint displacement, [-1, 1] -> 0.0125 rad
``joint_target`` (J)  joint position targets [rad], for planners
``joint_state`` (J)   joint positions [rad], set directly: the perfect controller (S I.1)
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
from dataclasses import dataclass
from functools import cache, partial
from itertools import product
from typing import Any

import numpy as np
import torch
from mani_skill.agents.controllers.base_controller import BaseController, ControllerConfig
from numpy.typing import NDArray
from torch import Tensor

from hab_tasks.arrays import Batch, Floats
from hab_tasks.constants import EE_STEP_M, JOINT_STEP_RAD, TARGET_STEP_RAD
from hab_tasks.errors import ActionError
from hab_tasks.robots.control_modes import (
    ABSOLUTE_ARM,
    BASE_CELLS,
    STOP_CELL,
    STOP_SHARE,
    ArmMode,
    BaseMode,
    action_bounds,
    action_size,
    action_space,
    arm_size,
    within_a_turn,
)
from hab_tasks.robots.joint_setter import JointSetter, base_way
from hab_tasks.robots.kinematics import ArmKinematics
from hab_tasks.robots.spec import RobotSpec
from hab_tasks.simulator import sapien_object

Array = NDArray[Any]


def commanded_arm(mode: ArmMode, qpos: Array, arm: Array, kinematics: ArmKinematics) -> Array:
    """Returns the commanded arm pose (J,) [rad] after an action with these arm entries.

    `qpos` (J,) float64 is the pose commanded before; in ``joint_state``, the true one.
    """
    if mode in ABSOLUTE_ARM:
        return np.minimum(np.maximum(arm, qpos - TARGET_STEP_RAD), qpos + TARGET_STEP_RAD)
    if mode == "joint_delta":
        moved = qpos + JOINT_STEP_RAD * arm
        return np.minimum(np.maximum(moved, kinematics.arm_lower_rad), kinematics.arm_upper_rad)
    return kinematics.move(qpos, EE_STEP_M * arm)


@cache
def ee_step_m(robot: RobotSpec, mode: ArmMode) -> float:
    """Returns the maximum displacement of the resting end-effector per action [m]."""
    if mode == "still":
        return 0.0
    if mode == "ee":
        return EE_STEP_M
    step_rad = JOINT_STEP_RAD if mode == "joint_delta" else TARGET_STEP_RAD
    _, jacobian = ArmKinematics(robot).position_and_jacobian(np.array(robot.rest_qpos_rad))
    corners = np.array(list(product((-1.0, 1.0), repeat=jacobian.shape[1])))
    return float(step_rad * np.linalg.norm(corners @ jacobian.T, axis=1).max())


_CELLS = np.array(BASE_CELLS, dtype=np.float32)


PUSH_APART_M_S = 1.0
"""Maximum depenetration velocity of the robot: without a limit, an arm set 5 cm deep into a wall
was ejected at 50 rad/s."""


class HabController(BaseController):
    """Converts a flat action to drive targets; keeps the commanded arm pose and gripper value.

    Attributes:
        arm_target_rad: (J,) commanded arm pose.
        gripper: Last gripper entry; the environment passes it to the snap grasp.
        base_target: (3,) commanded x, y [m] and yaw [rad], in modes with a base pose.
        stopped: Whether the last action was the stop action.
    """

    config: HabControllerConfig
    sets_target_qpos = True
    sets_target_qvel = True

    def _initialize_action_space(self) -> None:
        robot = self.config.robot
        self._low, self._high = action_bounds(robot, self.config.arm, self.config.base)
        self.single_action_space = action_space(robot, self.config.arm, self.config.base)
        self._kinematics = ArmKinematics(robot)
        self.arm_target_rad: Floats = np.zeros(len(robot.arm_joints), dtype=np.float32)
        self.base_target: Floats = np.zeros(3, dtype=np.float32)
        self.gripper, self.stopped = -1.0, False
        self._robot = sapien_object(self.articulation)
        self._joints = [sapien_object(joint) for joint in self.articulation.active_joints]
        names = [joint.name for joint in self.articulation.active_joints]
        self._arm = [names.index(name) for name in robot.arm_joints]
        self._base = [names.index(name) for name in robot.base_joints]
        self._locked = {names.index(name): value for name, value in robot.locked_qpos.items()}
        self._fingers = [self._joints[names.index(name)] for name in robot.finger_joints]
        self._arm_setter = JointSetter(self._robot, self._arm)
        self._base_setter = JointSetter(self._robot, self._base)
        self._arm_drives = [self._joints[i].set_drive_target for i in self._arm]
        self._base_drives = [self._joints[i].set_drive_velocity_target for i in self._base]

    def set_drive_property(self) -> None:
        """Sets all joint drives. A base that actions do not control is held in place."""
        c, fingers = self.config, self.config.robot.fingers
        if c.sets_joints:
            for link in self.articulation.links:
                sapien_object(link).set_max_depenetration_velocity(PUSH_APART_M_S)
        for joint in self.articulation.active_joints:
            if joint.name in c.robot.arm_joints:
                joint.set_drive_properties(
                    c.arm_stiffness, c.arm_damping, c.arm_force_n, mode="force"
                )
                joint.set_friction(0.1)
            elif joint.name in c.robot.base_joints:
                stiffness = c.base_stiffness if c.base in ("still", "pose") else 0.0
                joint.set_drive_properties(stiffness, c.base_damping, c.base_force_n, mode="force")
            elif fingers is not None and joint.name in fingers.joints:
                joint.set_drive_properties(
                    fingers.stiffness_n_m, fingers.damping_n_s_m, fingers.force_n, mode="force"
                )
            else:
                joint.set_drive_properties(c.lock_stiffness, c.lock_damping, 1000.0, mode="force")

    def reset(self) -> None:
        """Sets the commanded pose to the current pose."""
        qpos = self._robot.qpos
        self.arm_target_rad, self.base_target = qpos[self._arm], qpos[self._base]
        self.base_target[2] = within_a_turn(self.base_target[2])
        self.gripper = -1.0
        for index, joint in enumerate(self._joints):
            joint.set_drive_target(self._locked.get(index, float(qpos[index])))
            joint.set_drive_velocity_target(0.0)

    def move_fingers(self, opening_m: float) -> None:
        """Drives the fingers of a hand that grasps by friction to a joint position."""
        for joint in self._fingers:
            joint.set_drive_target(opening_m)

    def set_action(self, action: Tensor) -> None:
        """Sets drive targets from an action (1, A), or from one cell; raises as `check` does."""
        self.set_entries(self.check(action))

    def check(self, action: Tensor) -> Array:
        """Returns the entries (A,) of an action (1, A), or the cell (1,), if they are valid.

        Raises:
            ActionError: Wrong shape, a non-finite entry, or an invalid cell.
        """
        if self.config.base == "discrete":
            return self._cell(action.numpy())
        expected = (1, len(self._low))
        if tuple(action.shape) != expected:
            raise ActionError(f"Action of shape {tuple(action.shape)}; expected {expected}.")
        entries = action[0].numpy()
        # The sum is finite only if every entry is, and takes one operation instead of three.
        if not math.isfinite(float(entries.sum(dtype=np.float64))):
            raise ActionError(f"Action has a non-finite value: {action.tolist()}.")
        return entries

    def _cell(self, cell: Array) -> Array:
        """Returns a cell of shape (), (1,) or (1, 1) as (1,), if it is valid."""
        if cell.size != 1 or cell.ndim > 2:
            raise ActionError(f"Action of shape {cell.shape}; expected (1,).")
        flat = cell.reshape(1)
        number = float(flat[0])
        if not (number.is_integer() and 0 <= number < len(BASE_CELLS)):
            last = len(BASE_CELLS) - 1
            raise ActionError(f"Action {flat.tolist()}; valid cells are 0 to {last}.")
        return flat

    @property
    def action_size(self) -> int:
        """Number of values of an action: its entries, or one cell."""
        return 1 if self.config.base == "discrete" else self.config.size

    def idle_action(self, holding: bool) -> Array:
        """Returns the action (A,), or cell (1,), that stands still and keeps the grasp, if any."""
        if self.config.base == "discrete":
            return np.array([STOP_CELL], dtype=np.float32)
        action = np.zeros(len(self._low), dtype=np.float32)
        size = self.config.arm_size
        if self.config.arm in ABSOLUTE_ARM:
            action[:size] = self.arm_target_rad
        if self.config.base == "pose":
            action[-3:] = self.base_target
        if size:
            action[size] = 1.0 if holding else -1.0
        return action

    def set_entries(self, action: Array) -> None:
        """Sets the targets of a valid action (A,) or cell (1,)."""
        if self.config.base == "discrete":
            action = _CELLS[int(action[0])]
        elif self.config.base == "pose":
            action = np.concatenate((action[:-1], within_a_turn(action[-1:])))
        action = np.minimum(np.maximum(action, self._low), self._high)
        size = self.config.arm_size
        if size:
            self.gripper = float(action[size])
            if self.config.arm == "joint_state":
                qpos = self._arm_setter.values().astype(np.float64)
                self._arm_setter.begin(self._arm_target(qpos, action[:size]) - qpos)
            else:
                qpos = self._arm_target(self.arm_target_rad.astype(np.float64), action[:size])
                self.arm_target_rad = qpos.astype(np.float32)
                for drive, value in zip(self._arm_drives, qpos.tolist(), strict=True):
                    drive(value)
        if self.config.base == "pose":
            self._base_setter.begin(
                base_way(self.config.robot, self._base_setter.values(), action[-3:])
            )
        elif self.config.base != "still":
            self._drive_base(*action[-2:].tolist())

    def move_joints(self, share: float) -> None:
        """Sets the joints of modes that set them, after a share of the action."""
        if self.config.arm == "joint_state":
            self._arm_setter.move(share)
            self.arm_target_rad = self._arm_setter.values()
        if self.config.base == "pose":
            self._base_setter.move(share)
            self.base_target = self._base_setter.values()
            self.base_target[2] = within_a_turn(self.base_target[2])

    def _drive_base(self, linear: float, angular: float) -> None:
        self.stopped = abs(linear) <= STOP_SHARE and abs(angular) <= STOP_SHARE
        yaw = float(self._robot.qpos[self._base[2]])
        robot = self.config.robot
        forward = robot.base_linear_speed_m_s * linear
        x, y, turning = self._base_drives
        x(forward * math.cos(yaw))
        y(forward * math.sin(yaw))
        turning(robot.base_angular_speed_rad_s * angular)

    def get_state(self) -> dict[str, Tensor]:
        """Returns the commanded arm pose (1, J), gripper (1,) and, if any, base pose (1, 3)."""
        state = {
            "arm_target_rad": torch.tensor(self.arm_target_rad)[None],
            "gripper": torch.tensor([self.gripper]),
        }
        if self.config.base == "pose":
            state["base_target"] = torch.tensor(self.base_target)[None]
        return state

    def set_state(self, state: dict[str, Tensor]) -> None:
        """Restores a state of `get_state`."""
        self.arm_target_rad = state["arm_target_rad"][0].numpy().copy()
        self.gripper = float(state["gripper"][0])
        for drive, value in zip(self._arm_drives, self.arm_target_rad.tolist(), strict=True):
            drive(value)
        if self.config.base == "pose":
            self.base_target = state["base_target"][0].numpy().copy()
            for index, value in zip(self._base, self.base_target.tolist(), strict=True):
                self._joints[index].set_drive_target(value)

    def _arm_target(self, qpos: Array, arm: Array) -> Array:
        """Returns the commanded arm pose (J,) [rad] of an action's arm entries."""
        return commanded_arm(self.config.arm, qpos, arm, self._kinematics)


@dataclass
class HabControllerConfig(ControllerConfig):
    """Arm mode, base mode, and drive gains (see docs/deviations.md)."""

    robot: RobotSpec
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
        return action_size(self.robot, self.arm, self.base)

    @property
    def arm_size(self) -> int:
        """Number of entries of the arm, without the gripper."""
        return arm_size(self.robot, self.arm)

    @property
    def sets_joints(self) -> bool:
        """Whether actions set joint states directly instead of driving the joints."""
        return self.arm == "joint_state" or self.base == "pose"


def control_configs(robot: RobotSpec) -> dict[str, HabControllerConfig]:
    """Returns every control mode of a robot by name."""
    make = partial(HabControllerConfig, [*robot.arm_joints, *robot.base_joints], robot=robot)
    modes: dict[str, HabControllerConfig] = {}
    for arm in ("ee", "joint_delta", "joint_target", "joint_state"):
        modes[arm] = make(arm=arm, base="still")
        modes[f"{arm}_base"] = make(arm=arm, base="velocity")
    for arm in ABSOLUTE_ARM:
        modes[f"{arm}_pose"] = make(arm=arm, base="pose")
    modes["base"] = make(arm="still", base="velocity")
    modes["base_discrete"] = make(arm="still", base="discrete")
    return modes


LONGEST_STEPS = 1000
"""Maximum of the option `action_delay_steps`."""


class ActionDelay:
    """Queue of the last n actions of one robot."""

    def __init__(self, steps: int, controller: HabController) -> None:
        """Delays the actions of `controller` by `steps`, at least one."""
        self.steps, self._controller = steps, controller
        self._queue: list[Batch] = []

    def begin(self) -> None:
        """Clears the queue."""
        self._queue = []

    def exchange(self, action: Batch, holding: bool) -> Batch:
        """Queues a valid action (A,), and returns the one that is due.

        Until the first action is due, the robot stands still and keeps its grasp: `holding` is
        whether the hand holds an object or handle.
        """
        self._queue.append(np.array(action))  # the caller may reuse its memory
        if len(self._queue) > self.steps:
            return self._queue.pop(0)
        return self._controller.idle_action(holding)

    def get_state(self) -> dict[str, Tensor]:
        """Returns the queued actions (1, n, A), the latest last, and their number (1,)."""
        queue = torch.zeros(1, self.steps, self._controller.action_size)
        for number, action in enumerate(self._queue):
            queue[0, self.steps - len(self._queue) + number] = torch.as_tensor(action)
        return {"queue": queue, "filled": torch.tensor([len(self._queue)])}

    def set_state(self, state: dict[str, Tensor]) -> None:
        """Restores a state of `get_state`."""
        filled = int(state["filled"][0])
        self._queue = list(state["queue"][0, self.steps - filled :].numpy().copy())
