"""The one read of the simulator in a control step, and the contact force on the robot."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from hab_tasks.constants import CONTROL_HZ
from hab_tasks.robots.fetch import HabFetch
from hab_tasks.robots.fetch_spec import EE_OFFSET_M
from hab_tasks.robots.grasp import SnapGrasp


@dataclass(frozen=True, kw_only=True)
class Snapshot:
    """What the skills need to know of the simulator, batched; N rows.

    Attributes:
        arm_qpos_rad: (N, 7) arm joints.
        base: (N, 3) x [m], y [m], yaw [rad] of the base in the world.
        ee_m: (N, 3) end-effector point in the world.
        ee_in_base_m: (N, 3) the same point in the base frame.
        ee_axes: (N, 3, 3) axes of the gripper in the world, as columns.
        object_m: (N, 3) centre of mass of the target object in the world.
        held: (N,) index of the held object, -1 where none.
        held_handle: (N,) index of the held handle, -1 where none.
        lost: (N,) whether the held object was pulled out of the hand in this step.
        force_n: (N,) contact force on the robot, mean over the control step (see `ContactForce`).
    """

    arm_qpos_rad: Tensor
    base: Tensor
    ee_m: Tensor
    ee_in_base_m: Tensor
    ee_axes: Tensor
    object_m: Tensor
    held: Tensor
    held_handle: Tensor
    lost: Tensor
    force_n: Tensor


class SnapshotReader:
    """Reads a `Snapshot` for the present targets."""

    def __init__(self, agent: HabFetch, grasp: SnapGrasp) -> None:
        self._agent, self._grasp = agent, grasp
        self._on_cpu = not agent.scene.gpu_sim_enabled
        self._robot = agent.robot._objs[0]
        self._ee_link = agent.ee_link._objs[0]
        self._joints = agent.arm_index.tolist() + agent.base_index.tolist()
        self._bodies = [(a._bodies[0], a._bodies[0].cmass_local_pose) for a in grasp.objects]

    def read(self, target: Tensor, force_n: Tensor) -> Snapshot:
        """Reads all rows; `target` (N,) indexes the grasp's objects."""
        numbers = self._read_cpu(int(target)) if self._on_cpu else self._read_batch(target)
        arm, base, ee, ee_in_base, axes, target_m = numbers
        grasp = self._grasp
        return Snapshot(
            arm_qpos_rad=arm,
            base=base,
            ee_m=ee,
            ee_in_base_m=ee_in_base,
            ee_axes=axes,
            object_m=target_m,
            held=grasp.held,
            held_handle=grasp.held_handle,
            lost=grasp.lost,
            force_n=force_n,
        )

    def _read_cpu(self, target: int) -> tuple[Tensor, ...]:
        qpos = self._robot.get_qpos()
        matrix = self._ee_link.entity_pose.to_transformation_matrix()
        body, com = self._bodies[target]
        raw = np.empty((1, 28), dtype=np.float32)
        now = raw[0]
        now[:10] = qpos[self._joints]
        now[10:13] = matrix[:3, 3] + EE_OFFSET_M * matrix[:3, 0]
        now[13:22] = matrix[:3, :3].reshape(-1)
        now[22:25] = (body.entity_pose * com).p
        base_x, base_y, yaw = now[7:10].tolist()
        ee_x, ee_y, ee_z = now[10:13].tolist()
        x, y, cosine, sine = ee_x - base_x, ee_y - base_y, math.cos(yaw), math.sin(yaw)
        now[25:] = cosine * x + sine * y, cosine * y - sine * x, ee_z
        arm, base, ee, axes, point, ee_in_base = torch.from_numpy(raw).split_with_sizes(
            (7, 3, 3, 9, 3, 3), dim=1
        )
        return arm, base, ee, ee_in_base, axes.view(1, 3, 3), point

    def _read_batch(self, target: Tensor) -> tuple[Tensor, ...]:
        agent = self._agent
        qpos = agent.robot.get_qpos()
        axes = agent.ee_link.pose.to_transformation_matrix()[:, :3, :3]
        ee = agent.ee_link.pose.p + EE_OFFSET_M * axes[:, :, 0]
        points = self._grasp.objects_com_m()
        target_m = points[torch.arange(len(points), device=points.device), target]
        base = qpos[:, agent.base_index]
        return qpos[:, agent.arm_index], base, ee, world_to_base(base, ee), axes, target_m


def world_to_base(base: Tensor, points_m: Tensor) -> Tensor:
    """Maps world points (N, 3) to the base frames (N, 3: x, y, yaw); heights stay."""
    offset = points_m[:, :2] - base[:, :2]
    cosine, sine = torch.cos(base[:, 2]), torch.sin(base[:, 2])
    x, y = offset[:, 0], offset[:, 1]
    return torch.stack((cosine * x + sine * y, cosine * y - sine * x, points_m[:, 2]), dim=1)


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

    def newton(self) -> Tensor:
        """Returns the mean force (N,) [N] since `clear`."""
        if self._on_cpu:
            return torch.full((1,), self._cpu_impulse_n_s * CONTROL_HZ)
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
