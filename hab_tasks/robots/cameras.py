"""Sensor cameras of a robot: head, arm and third-person (S 5, F.3)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
import sapien
import torch
from mani_skill.sensors.camera import CameraConfig
from mani_skill.utils.sapien_utils import look_at
from mani_skill.utils.structs import Link
from torch import Tensor

from hab_tasks import option_values
from hab_tasks.arrays import Floats
from hab_tasks.constants import CAMERA_DEPTH_MAX_M, CAMERA_HFOV_RAD, CAMERA_SIZE_PX
from hab_tasks.errors import OptionError, UnknownNameError
from hab_tasks.robots.spec import CameraPlace, RobotSpec
from hab_tasks.simulator import sapien_object
from hab_tasks.world.raycast.scene import cv_from_world


def camera_pose(place: CameraPlace) -> sapien.Pose:
    """Returns a camera's pose in its link's frame."""
    if place.target_m is None:
        return sapien.Pose(list(place.position_m))
    return look_at(place.position_m, place.target_m).sp


GL_FROM_CV = np.diag([1.0, -1.0, -1.0, 1.0])
"""OpenGL's camera frame: x right, y up, z backwards."""


def specified_pose(camera: Any) -> sapien.Pose:
    """Returns a camera's pose of its settings, in the frame of its mount, if it has one."""
    return camera.config.pose.sp


def cv_from_world_of(camera: Any, local_pose: sapien.Pose) -> Floats:
    """Returns the world's current pose (4, 4) in a camera's frame, if it is at `local_pose`."""
    if camera.entity is None:
        return cv_from_world(local_pose)
    return cv_from_world(sapien_object(camera.entity).entity.pose * local_pose)


def pose_params(camera: Any, local_pose: sapien.Pose) -> dict[str, Tensor]:
    """Returns ManiSkill's matrices (1, 3, 4) and (1, 4, 4) of a camera at `local_pose`."""
    extrinsic = cv_from_world_of(camera, local_pose)
    found = {"extrinsic_cv": extrinsic[:3], "cam2world_gl": np.linalg.inv(GL_FROM_CV @ extrinsic)}
    return {name: torch.from_numpy(matrix.astype("f4"))[None] for name, matrix in found.items()}


LARGEST_SIZE_PX = 8192


@dataclass(frozen=True, kw_only=True)
class CameraRig:
    """Sensor cameras of a robot, some of its `places`; square images with equal settings."""

    places: Mapping[str, CameraPlace] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    size_px: int = CAMERA_SIZE_PX
    hfov_rad: float = CAMERA_HFOV_RAD

    @classmethod
    def of(cls, robot: RobotSpec, names: Iterable[str], size_px: int, hfov_rad: float) -> CameraRig:
        """Returns the rig of a robot for the given options.

        Raises:
            UnknownNameError: Unknown camera.
            OptionError: Invalid size or field of view.
        """
        chosen = option_values.names("cameras", names, list(robot.cameras))
        for name in chosen:
            if name not in robot.cameras:
                raise UnknownNameError("camera", name, robot.cameras)
        size_px = option_values.whole("camera_size_px", size_px, 1, LARGEST_SIZE_PX, "pixels")
        valid = "an angle between 0 and pi [rad]"
        if not 0.0 < option_values.number("camera_hfov_rad", hfov_rad, valid) < math.pi:
            raise OptionError.of_value("camera_hfov_rad", hfov_rad, valid)
        # In the robot's order, without duplicates.
        ordered = tuple(name for name in robot.cameras if name in chosen)
        return cls(places=robot.cameras, names=ordered, size_px=size_px, hfov_rad=hfov_rad)

    def configs(self, link: Callable[[str], Link]) -> list[CameraConfig]:
        """Returns ManiSkill's settings of the cameras; `link` looks up a robot link by name."""
        return [
            CameraConfig(
                uid=name,
                pose=camera_pose(self.places[name]),  # type: ignore[arg-type]
                width=self.size_px,
                height=self.size_px,
                fov=self.hfov_rad,
                near=0.01,
                far=CAMERA_DEPTH_MAX_M,
                mount=link(self.places[name].link),
            )
            for name in self.names
        ]


SETTINGS = tuple(setting.name for setting in fields(CameraConfig))


def split_sensor_configs(
    configs: Any, known: Iterable[str]
) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """Returns ManiSkill's `sensor_configs` without its new cameras, and the new cameras by name.

    Raises:
        UnknownNameError: Unknown setting.
        OptionError: `configs` is not a dict, or a new camera has no pose.
    """
    names, changes, new = set(known), {}, {}
    for name, value in option_values.entries("sensor_configs", configs).items():
        if isinstance(value, CameraConfig):
            value = {key: getattr(value, key) for key in SETTINGS if key != "shader_config"}
        if isinstance(value, Mapping):
            for setting in value:
                if setting not in (*SETTINGS, "use_stereo_depth"):
                    raise UnknownNameError(f"setting of camera {name!r}", setting, SETTINGS)
            if name not in names and "pose" not in value:
                raise UnknownNameError("camera in sensor_configs without a pose", name, names)
        elif name not in (*SETTINGS, "use_stereo_depth"):
            raise UnknownNameError("entry of sensor_configs", name, (*names, *SETTINGS))
        (new if isinstance(value, Mapping) and name not in names else changes)[name] = value
    return changes, new


def new_camera(
    name: str, settings: Mapping[str, Any], rig: CameraRig, link: Callable[[str], Link]
) -> CameraConfig:
    """Returns a camera of `sensor_configs`; `mount` or `entity_uid` may name a link of the robot.

    Size and field of view are those of the `rig` unless given.
    """
    known = {"width": rig.size_px, "height": rig.size_px, "far": CAMERA_DEPTH_MAX_M}
    if settings.get("intrinsic") is None:
        known["fov"] = rig.hfov_rad
    known |= {**settings, "uid": name}
    mount = known.pop("entity_uid", None) or known.get("mount")
    known["mount"] = link(mount) if isinstance(mount, str) else mount
    if isinstance(known["pose"], list | tuple):  # JSON has no poses
        if len(known["pose"]) != 7:
            valid = "a Pose, or [x, y, z, qw, qx, qy, qz]"
            raise OptionError.of_value(f"pose of camera {name!r}", known["pose"], valid)
        known["pose"] = sapien.Pose(known["pose"][:3], known["pose"][3:])
    return CameraConfig(**known)


def hidden_links(robot: RobotSpec) -> tuple[str, ...]:
    """Returns the links that `HiddenArm` hides: shoulder, arm, gripper and fingers."""
    return (*robot.arm_links, robot.ee_link, *robot.finger_links)


class HiddenVisuals:
    """Visuals that only the human-render camera sees.

    ManiSkill calls `hide_visual` of its `_hidden_objects` before it renders sensors, and
    `show_visual` before it renders for humans. On a GPU, objects that were hidden when the renderer
    was set up stay hidden.
    """

    _visuals: list[sapien.render.RenderBodyComponent]

    def hide_visual(self) -> None:
        """Hides them."""
        for visual in self._visuals:
            visual.visibility = 0.0

    def show_visual(self) -> None:
        """Shows them."""
        for visual in self._visuals:
            visual.visibility = 1.0


class HiddenArm(HiddenVisuals):
    """Hides the arm from all but the human-render camera (S F.3); collisions are unaffected."""

    def __init__(self, robot: RobotSpec, link: Callable[[str], Link]) -> None:
        """Hides shoulder, arm, gripper and fingers; `link` looks up a link by name."""
        self._visuals = [
            component
            for name in hidden_links(robot)
            for component in sapien_object(link(name)).entity.components
            if isinstance(component, sapien.render.RenderBodyComponent)
        ]
        self.hide_visual()
