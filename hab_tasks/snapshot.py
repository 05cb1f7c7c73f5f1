"""The one read of the simulator in a control step, and the contact force on the robot."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import sapien
import torch
from torch import Tensor

from hab_tasks.arrays import Rows, cos, sin, stack
from hab_tasks.constants import CONTROL_HZ
from hab_tasks.robots.fetch import HabFetch
from hab_tasks.robots.fetch_spec import EE_OFFSET_M
from hab_tasks.robots.grasp import Handle, SnapGrasp


@dataclass(frozen=True, kw_only=True)
class Snapshot:
    """What the skills need to know of the simulator, batched; N rows.

    Attributes:
        arm_qpos_rad: (N, 7) arm joints.
        base: (N, 3) x [m], y [m], yaw [rad] of the base in the world.
        base_axes: (N, 3, 3) axes of the base frame in the world, as columns.
        ee_m: (N, 3) end-effector point in the world.
        ee_in_base_m: (N, 3) the same point in the base frame.
        ee_axes: (N, 3, 3) axes of the gripper in the world, as columns.
        objects_m: (N, K, 3) centres of mass of the objects to rearrange, in the world.
        handles_m: (N, J, 3) handles of the doors and drawers that are asked about, in the world.
        joints: (N, J) position of their joints [m or rad].
        held: (N,) index of the held object, -1 where none.
        held_handle: (N,) index of the held handle, -1 where none.
        lost: (N,) whether the held object was pulled out of the hand in this step.
        force_n: (N,) contact force on the robot, mean over the control step (see `ContactForce`).
    """

    arm_qpos_rad: Rows
    base: Rows
    base_axes: Rows
    ee_m: Rows
    ee_in_base_m: Rows
    ee_axes: Rows
    objects_m: Rows
    handles_m: Rows
    joints: Rows
    held: Rows
    held_handle: Rows
    lost: Rows
    force_n: Rows


class SnapshotReader:
    """Reads a `Snapshot` of the robot, and of the objects and handles that are asked about."""

    def __init__(self, agent: HabFetch, grasp: SnapGrasp) -> None:
        self._agent, self._grasp = agent, grasp
        self._on_cpu = not agent.scene.gpu_sim_enabled
        self._robot = agent.robot._objs[0]
        self._ee_link = agent.ee_link._objs[0]
        self._joints = agent.arm_index.tolist() + agent.base_index.tolist()
        self._bodies = [(a._bodies[0], a._bodies[0].cmass_local_pose) for a in grasp.objects]
        self._fronts = [_FrontReader(handle) for handle in grasp.handles]

    def read(self, targets: Rows, handles: Rows, force_n: Rows) -> Snapshot:
        """Reads all rows.

        Args:
            targets: (N, K) indices of the grasp's objects.
            handles: (N, J) indices of the grasp's handles.
            force_n: (N,) contact force of the step.
        """
        if self._on_cpu:
            numbers = self._read_cpu(targets[0].tolist(), handles[0].tolist())
        else:
            numbers = self._read_batch(targets, handles)
        arm, base, base_axes, ee, ee_in_base, axes, objects_m, handles_m, joints = numbers
        held, held_handle, lost = self._grasp.held, self._grasp.held_handle, self._grasp.lost
        if self._on_cpu:
            held, held_handle, lost = held.numpy(), held_handle.numpy(), lost.numpy()
        return Snapshot(
            arm_qpos_rad=arm,
            base=base,
            base_axes=base_axes,
            ee_m=ee,
            ee_in_base_m=ee_in_base,
            ee_axes=axes,
            objects_m=objects_m,
            handles_m=handles_m,
            joints=joints,
            held=held,
            held_handle=held_handle,
            lost=lost,
            force_n=force_n,
        )

    def _read_cpu(self, targets: list[int], handles: list[int]) -> tuple[Rows, ...]:
        qpos = self._robot.get_qpos()
        matrix = self._ee_link.entity_pose.to_transformation_matrix()
        objects, fronts = len(targets), len(handles)
        raw = np.empty((1, 34 + 3 * objects + 4 * fronts), dtype=np.float32)
        now = raw[0]
        now[:10] = qpos[self._joints]
        now[10:13] = matrix[:3, 3] + EE_OFFSET_M * matrix[:3, 0]
        now[13:22] = matrix[:3, :3].reshape(-1)
        base_x, base_y, yaw = now[7:10].tolist()
        ee_x, ee_y, ee_z = now[10:13].tolist()
        x, y, cosine, sine = ee_x - base_x, ee_y - base_y, math.cos(yaw), math.sin(yaw)
        ee_in_base = cosine * x + sine * y, cosine * y - sine * x, ee_z
        now[22:34] = *ee_in_base, cosine, -sine, 0.0, sine, cosine, 0.0, 0.0, 0.0, 1.0
        at = 34
        for index in targets:
            body, com = self._bodies[index]
            now[at : at + 3] = (body.entity_pose * com).p
            at += 3
        for number, index in enumerate(handles):
            now[at : at + 3] = self._fronts[index].handle_m()
            now[number - fronts] = self._fronts[index].joint()
            at += 3
        ends = 34 + 3 * objects, 34 + 3 * (objects + fronts)
        return (
            raw[:, :7],
            raw[:, 7:10],
            raw[:, 25:34].reshape(1, 3, 3),
            raw[:, 10:13],
            raw[:, 22:25],
            raw[:, 13:22].reshape(1, 3, 3),
            raw[:, 34 : ends[0]].reshape(1, objects, 3),
            raw[:, ends[0] : ends[1]].reshape(1, fronts, 3),
            raw[:, ends[1] :],
        )

    def _read_batch(self, targets: Tensor, handles: Tensor) -> tuple[Tensor, ...]:
        agent, grasp = self._agent, self._grasp
        qpos = agent.robot.get_qpos()
        axes = agent.ee_link.pose.to_transformation_matrix()[:, :3, :3]
        ee = agent.ee_link.pose.p + EE_OFFSET_M * axes[:, :, 0]
        rows = torch.arange(len(qpos), device=qpos.device)[:, None]
        base = qpos[:, agent.base_index]
        points = grasp.objects_com_m()[rows, targets]
        grips, joints = base.new_zeros(*handles.shape, 3), base.new_zeros(*handles.shape)
        for index in torch.unique(handles).tolist():
            here = handles == index
            grips = torch.where(here[..., None], grasp.handle_position_m(index)[:, None], grips)
            joints = torch.where(here, self._fronts[index].batch_joint()[:, None], joints)
        arm, in_base = qpos[:, agent.arm_index], world_to_base(base, ee)
        return arm, base, axes_of_base(base), ee, in_base, axes, points, grips, joints


class _FrontReader:
    """Reads the handle and the joint of a door or drawer."""

    def __init__(self, handle: Handle) -> None:
        self._link, self._offset = handle.link._objs[0], sapien.Pose(list(handle.offset_m))
        self._furniture = handle.furniture
        self._robot = handle.furniture._objs[0]
        self._column = handle.column

    def handle_m(self) -> Any:
        """Returns the handle (3,) in the world; CPU simulation."""
        return (self._link.entity_pose * self._offset).p

    def joint(self) -> float:
        """Returns the joint's position [m or rad]; CPU simulation."""
        return float(self._robot.qpos[self._column])

    def batch_joint(self) -> Tensor:
        """Returns the joint's positions (N,) [m or rad]."""
        return self._furniture.get_qpos()[:, self._column]


def world_to_base(base: Rows, points_m: Rows) -> Rows:
    """Maps world points (N, 3) to the base frames (N, 3: x, y, yaw); heights stay."""
    offset = points_m[:, :2] - base[:, :2]
    cosine, sine = cos(base[:, 2]), sin(base[:, 2])
    x, y = offset[:, 0], offset[:, 1]
    return stack((cosine * x + sine * y, cosine * y - sine * x, points_m[:, 2]), axis=1)


def axes_of_base(base: Rows) -> Rows:
    """Returns the axes of base frames (N, 3: x, y, yaw) in the world as columns, (N, 3, 3)."""
    cosine, sine = cos(base[:, 2]), sin(base[:, 2])
    zero = base[:, 2] * 0.0
    rows = (cosine, -sine, zero, sine, cosine, zero, zero, zero, zero + 1.0)
    return stack(rows, axis=1).reshape(-1, 3, 3)


class ContactForce:
    """C_t: contact force on the robot's links in a control step, held object excluded.

    The magnitudes of all contact impulses on the robot [N s], summed over links and over the
    physics steps of one action, divided by the action's duration [s]: a mean force in newton.
    On the GPU the engine gives the net impulse of each link, so opposite contacts on one link
    cancel there.
    """

    def __init__(self, agent: HabFetch, grasp: SnapGrasp) -> None:
        self._agent, self._grasp = agent, grasp
        self._px: Any = agent.scene.px
        self._on_cpu = not agent.scene.gpu_sim_enabled
        self._links = {link._objs[0] for link in agent.robot.links}
        self._impulse_n_s = torch.zeros(agent.scene.num_envs, device=agent.device)
        self._cpu_impulse_n_s = 0.0

    def clear(self) -> None:
        """Starts a new control step."""
        self._cpu_impulse_n_s = 0.0
        self._impulse_n_s = torch.zeros_like(self._impulse_n_s)

    def add_physics_step(self) -> None:
        """Adds the contacts of the physics step that just ended."""
        if not self._on_cpu:
            self._add_batch()
            return
        contacts = self._px.get_contacts()
        if contacts:
            self._add_contacts(contacts)

    def newton(self) -> Rows:
        """Returns the mean force (N,) [N] since `clear`."""
        if self._on_cpu:
            return np.array([self._cpu_impulse_n_s * CONTROL_HZ], dtype=np.float32)
        return self._impulse_n_s * CONTROL_HZ

    def _add_contacts(self, contacts: list[Any]) -> None:
        links = self._links
        for contact in contacts:
            first, second = contact.bodies
            # The held object is filtered from the robot by the engine, so it is not among these.
            if first in links or second in links:
                for point in contact.points:
                    x, y, z = point.impulse.tolist()
                    self._cpu_impulse_n_s += (x * x + y * y + z * z) ** 0.5

    def _add_batch(self) -> None:
        for link in self._agent.robot.links:
            impulse = link.get_net_contact_impulses()
            self._impulse_n_s = self._impulse_n_s + torch.linalg.norm(impulse, dim=-1)
