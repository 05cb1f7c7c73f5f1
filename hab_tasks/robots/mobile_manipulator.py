"""ManiSkill agent of the robot: links, joints, rest pose, control and cameras."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import sapien
import torch
from mani_skill.agents.base_agent import BaseAgent
from mani_skill.sensors.camera import CameraConfig
from mani_skill.utils.structs import Link
from torch import Tensor

from hab_tasks.errors import UnknownNameError
from hab_tasks.robots.cameras import CameraRig
from hab_tasks.robots.control import HabController, HabControllerConfig, control_configs
from hab_tasks.robots.description import simulated_srdf, simulated_urdf
from hab_tasks.robots.spec import RobotSpec
from hab_tasks.simulator import sapien_object
from hab_tasks.world.scenes.physics import FLOOR_BIT, HAND, ROBOT, set_groups
from hab_tasks.world.scenes.urdf import articulation_builder, urdf_file


class MobileManipulator(BaseAgent):
    """A robot with the paper's control.

    Attributes:
        spec: Its links, joints, rest pose and base.
        rig: The sensor cameras, read when the environment sets up its sensors.
        new_cameras: Further ones, of the option `sensor_configs`.
    """

    spec: ClassVar[RobotSpec]
    fix_root_link = True
    controller: HabController  # type: ignore[assignment]
    rig = CameraRig()
    new_cameras: Sequence[CameraConfig] = ()

    @property
    def _controller_configs(self) -> dict[str, HabControllerConfig]:  # type: ignore[override]
        return control_configs(self.spec)

    @property
    def _sensor_configs(self) -> list[CameraConfig]:  # type: ignore[override]
        return [*self.rig.configs(self.link), *self.new_cameras]

    def _load_articulation(self, initial_pose: object = None) -> None:
        start = sapien.Pose([0.0, 0.0, self.spec.base_height_m])
        if initial_pose is None and not (self.scene.can_render() or self.build_separate):
            self._load_parsed(start)
            return
        with urdf_file(simulated_urdf(self.spec, self.scene.can_render()), self.uid) as path:
            path.with_suffix(".srdf").write_text(simulated_srdf(self.spec), encoding="utf-8")
            self.urdf_path = str(path)
            super()._load_articulation(start if initial_pose is None else initial_pose)  # type: ignore[arg-type]

    def _load_parsed(self, start: sapien.Pose) -> None:
        """Loads the robot as ManiSkill does, but parses its URDF once for all scenes."""
        name = self.uid if self._agent_idx is None else f"{self.uid}-agent-{self._agent_idx}"
        text, srdf = simulated_urdf(self.spec, visuals=False), simulated_srdf(self.spec)
        with articulation_builder(self.scene, text, name, srdf=srdf) as builder:
            builder.initial_pose = start
            self.robot = builder.build()
        self.robot_link_names = [link.name for link in self.robot.get_links()]

    def _after_init(self) -> None:
        self.ee_link = self.link(self.spec.ee_link)
        self.base_link = self.link(self.spec.base_link)
        self.link_from_ee = sapien.Pose([self.spec.ee_offset_m, 0.0, 0.0])
        fingers = [self.link(name) for name in self.spec.finger_links]
        for link in self.robot.links:
            is_hand = link is self.ee_link or link in fingers
            set_groups(sapien_object(link), HAND if is_hand else ROBOT)
        for shape in sapien_object(self.base_link).collision_shapes:
            groups = shape.get_collision_groups()
            groups[2] |= FLOOR_BIT
            shape.set_collision_groups(groups)
        self.joint_index = {joint.name: i for i, joint in enumerate(self.robot.active_joints)}
        self.arm_index = self._indices(self.spec.arm_joints)
        self.base_index = self._indices(self.spec.base_joints)

    def _indices(self, joints: tuple[str, ...]) -> Tensor:
        return torch.tensor([self.joint_index[name] for name in joints], device=self.device)

    def link(self, name: str) -> Link:
        """Returns a link by name; raises UnknownNameError."""
        if name not in self.robot.links_map:
            raise UnknownNameError(f"link of {self.uid}", name, self.robot.links_map)
        return self.robot.links_map[name]

    def rest_qpos(self) -> Tensor:
        """Returns joint positions (J,): base at the origin, arm at rest, other joints locked."""
        qpos = torch.zeros(len(self.joint_index), device=self.device)
        arm = dict(zip(self.spec.arm_joints, self.spec.rest_qpos_rad, strict=True))
        for name, value in {**self.spec.locked_qpos, **arm}.items():
            qpos[self.joint_index[name]] = value
        return qpos
