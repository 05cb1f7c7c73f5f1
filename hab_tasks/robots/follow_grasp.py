"""Snap grasp of the GPU simulation, which cannot create constraints while running."""

from __future__ import annotations

from typing import Any

import torch
from mani_skill.envs.scene import ManiSkillScene
from mani_skill.utils.structs import Actor, Articulation, Link
from mani_skill.utils.structs.pose import Pose
from torch import Tensor

from hab_tasks.robots.drive_grasp import DriveGrasp
from hab_tasks.robots.grasp import NOTHING, Handle, SnapGrasp
from hab_tasks.robots.handle_tie import HANDLE_SPRING
from hab_tasks.simulator import pull_from_gpu, push_to_gpu


class FollowGrasp(SnapGrasp):
    """Holds objects by setting their poses, and handles by a spring force."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self._pulled: dict[str, Articulation] = {}

    def _tie_object(self, row: int, index: int) -> None:
        pass

    def _tie_handle(self, row: int, index: int) -> None:
        pass

    def _untie(self, row: int) -> None:
        pass

    def before_simulation_step(self) -> None:
        """Sets the poses of held objects, and pulls held handles to the hand."""
        if self.scene.gpu_sim_enabled:
            pull_from_gpu(self.scene)
        for index in torch.unique(self.held[self.held != NOTHING]).tolist():
            self._pose_object(index)
        self._pull_handles()
        if self.scene.gpu_sim_enabled:
            push_to_gpu(self.scene)

    def _pose_object(self, index: int) -> None:
        rows = self.held == index
        actor, mask = self.objects[index], self.scene._reset_mask
        self.scene._reset_mask = rows
        actor.set_pose(Pose.create((self.ee_link.pose * self._ee_from_object).raw_pose[rows]))
        # The hand's velocity keeps the object from lagging behind during the physics step.
        turning = self.ee_link.get_angular_velocity()
        middle = (self.ee_link.pose * Pose.create_from_pq(self._link_com_m)).p
        arm = self.object_com_m(index) - middle
        moving = self.ee_link.get_linear_velocity() + torch.linalg.cross(turning, arm)
        actor.set_linear_velocity(moving[rows])
        actor.set_angular_velocity(turning[rows])
        self.scene._reset_mask = mask

    def _pull_handles(self) -> None:
        """Sets the joint efforts of held furniture, and clears those of released furniture."""
        efforts = {
            name: torch.zeros_like(furniture.get_qpos()) for name, furniture in self._pulled.items()
        }
        for index in torch.unique(self.held_handle[self.held_handle != NOTHING]).tolist():
            handle = self.handles[index]
            name = handle.furniture.name
            self._pulled[name] = handle.furniture
            effort = efforts.setdefault(name, torch.zeros_like(handle.furniture.get_qpos()))
            column = handle.column
            effort[:, column] += self._effort(index) * (self.held_handle == index)
        for name, effort in efforts.items():
            self._pulled[name].set_qf(effort)
        if not bool((self.held_handle != NOTHING).any()):
            self._pulled = {}

    def _effort(self, index: int) -> Tensor:
        """Returns the effort (N,) [N or N m] at a handle's joint that pulls it to the hand."""
        handle = self.handles[index]
        point = self.handle_position_m(index)
        velocity = handle.link.get_linear_velocity() + torch.linalg.cross(
            handle.link.get_angular_velocity(), point - handle.link.pose.p
        )
        target = torch.as_tensor(self._handle_in_ee_m, device=self.scene.device) + self._offset
        wanted = (self.ee_link.pose * Pose.create_from_pq(target)).p
        spring = HANDLE_SPRING
        force = spring.stiffness_n_m * (wanted - point) - spring.damping_n_s_m * velocity
        force = force.clamp(-spring.force_n, spring.force_n)
        joint = handle.link.joint
        frame = joint.get_global_pose()
        # In SAPIEN, the joint axis is the x axis of the joint frame.
        axis = frame.to_transformation_matrix()[:, :3, 0]
        if joint.type[0] == "prismatic":
            return (axis * force).sum(dim=1)
        return (axis * torch.linalg.cross(point - frame.p, force)).sum(dim=1)


def make_grasp(
    scene: ManiSkillScene,
    ee_link: Link,
    objects: list[Actor],
    handles: list[Handle],
    takes: str = "any",
    *,
    arm_is_set: bool = False,
) -> SnapGrasp:
    """Returns the grasp for the scene's backend and the control mode."""
    if scene.gpu_sim_enabled:
        return FollowGrasp(scene, ee_link, objects, handles, takes)
    return DriveGrasp(scene, ee_link, objects, handles, takes, pulls_along=arm_is_set)
