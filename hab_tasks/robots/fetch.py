"""`hab_fetch`: ManiSkill's Fetch with the paper's control, cameras and rest pose."""

from __future__ import annotations

from functools import lru_cache
from xml.etree import ElementTree

import sapien
import torch
from mani_skill.agents.base_agent import BaseAgent
from mani_skill.agents.registration import register_agent
from mani_skill.sensors.camera import CameraConfig
from mani_skill.utils.structs import Link
from torch import Tensor

from hab_tasks.robots.cameras import CameraRig
from hab_tasks.robots.control import HabController, HabControllerConfig, control_configs
from hab_tasks.robots.fetch_spec import (
    ARM_JOINTS,
    BASE_JOINTS,
    EE_LINK,
    LOCKED_QPOS,
    REST_QPOS_RAD,
    urdf_path,
)
from hab_tasks.robots.light_visuals import lighten
from hab_tasks.scenes.collision_groups import FLOOR_BIT, ROBOT, set_groups
from hab_tasks.scenes.urdf import remove_visuals, urdf_file

BASE_HEIGHT_M = 0.005
"""Fetch's base mesh ends at z = 0; it is held this far above the floor so that it never rubs."""


NEAR_PAIRS = (("head_pan_link", "shoulder_lift_link"), ("head_tilt_link", "shoulder_lift_link"))
"""Links that come within 2 cm of each other in the resting pose and never touch in any (the least
distance is 1.9 cm): the engine would look for contacts between them in every step."""


@lru_cache(maxsize=2)
def _fetch_urdf(visuals: bool) -> str:
    """Returns the URDF of Fetch, with light visuals or with none.

    Wheels lose their collision shapes: they lie inside the base's outline and touch only the floor.
    """
    source = urdf_path()
    root = ElementTree.parse(source).getroot()
    if visuals:
        lighten(root, source.parent)
    else:
        remove_visuals(root)
    for link in root.iter("link"):
        if "wheel" in link.get("name", ""):
            for collision in link.findall("collision"):
                link.remove(collision)
    for mesh in root.iter("mesh"):
        mesh.set("filename", str((source.parent / mesh.get("filename", "")).resolve()))
    return ElementTree.tostring(root, encoding="unicode")


@lru_cache(maxsize=1)
def _ignored_pairs() -> str:
    """Returns the SRDF: link pairs that do not collide, with those that only come near."""
    root = ElementTree.parse(urdf_path().with_suffix(".srdf")).getroot()
    for first, second in NEAR_PAIRS:
        ElementTree.SubElement(
            root, "disable_collisions", link1=first, link2=second, reason="Default"
        )
    return ElementTree.tostring(root, encoding="unicode")


@register_agent()
class HabFetch(BaseAgent):
    """Fetch with torso, head and fingers locked where the paper locks them."""

    uid = "hab_fetch"
    fix_root_link = True
    controller: HabController  # type: ignore[assignment]
    rig = CameraRig()
    """The sensor cameras, read when the environment sets its sensors up."""

    @property
    def _controller_configs(self) -> dict[str, HabControllerConfig]:  # type: ignore[override]
        return control_configs()

    @property
    def _sensor_configs(self) -> list[CameraConfig]:  # type: ignore[override]
        return self.rig.configs(self.link)

    def _load_articulation(self, initial_pose: object = None) -> None:
        start = sapien.Pose([0.0, 0.0, BASE_HEIGHT_M]) if initial_pose is None else initial_pose
        with urdf_file(_fetch_urdf(visuals=self.scene.can_render()), "hab_fetch") as path:
            path.with_suffix(".srdf").write_text(_ignored_pairs(), encoding="utf-8")
            self.urdf_path = str(path)
            super()._load_articulation(start)  # type: ignore[arg-type]

    def _after_init(self) -> None:
        self.ee_link = self.link(EE_LINK)
        self.base_link = self.link("base_link")
        for link in self.robot.links:
            for body in link._objs:
                set_groups(body, ROBOT)
        for body in self.base_link._objs:
            for shape in body.collision_shapes:
                groups = shape.get_collision_groups()
                groups[2] |= FLOOR_BIT
                shape.set_collision_groups(groups)
        index = {joint.name: i for i, joint in enumerate(self.robot.active_joints)}
        self.arm_index = torch.tensor([index[name] for name in ARM_JOINTS], device=self.device)
        self.base_index = torch.tensor([index[name] for name in BASE_JOINTS], device=self.device)
        self.joint_index = index

    def link(self, name: str) -> Link:
        """Returns a link by name."""
        return self.robot.links_map[name]

    def rest_qpos(self) -> Tensor:
        """Returns (15,) joint positions: base at the origin, arm at rest, the others locked."""
        qpos = torch.zeros(len(self.joint_index), device=self.device)
        for name, value in {
            **LOCKED_QPOS,
            **dict(zip(ARM_JOINTS, REST_QPOS_RAD, strict=True)),
        }.items():
            qpos[self.joint_index[name]] = value
        return qpos
