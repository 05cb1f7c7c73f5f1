"""Visible bodies and depth sensors of an environment without a renderer."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any

import numpy as np
import torch
from mani_skill.envs.utils.observations import CameraObsTextures
from mani_skill.sensors.base_sensor import BaseSensor
from mani_skill.sensors.camera import Camera, CameraConfig
from torch import Tensor

from hab_tasks.engine.episode_simulation import EpisodeSimulation
from hab_tasks.engine.noise import Images
from hab_tasks.robots.cameras import (
    cv_from_world_of,
    hidden_links,
    pose_params,
    specified_pose,
)
from hab_tasks.robots.description import simulated_urdf
from hab_tasks.robots.mobile_manipulator import MobileManipulator
from hab_tasks.simulator import change_cameras, sapien_object
from hab_tasks.world.raycast.scene import Pinhole, RayBody, RayImage, RayScene
from hab_tasks.world.scenes.visuals import (
    furniture_visuals,
    stage_visuals,
    template_visuals,
    urdf_visuals,
)

ROBOT = "robot"
"""Prefix of the names of the robot's links."""


def visible_bodies(
    simulation: EpisodeSimulation, agent: MobileManipulator, hidden: Collection[str] = ()
) -> Iterator[RayBody]:
    """Yields the bodies of the active layout and the robot, without its `hidden` links."""
    active = simulation.scene_bodies
    spec, templates = active.spec, simulation.source.objects
    stage: Any = sapien_object(active.stage)
    yield RayBody(name="stage", visuals=stage_visuals(spec.stage), entity=stage, moves=False)
    for item in spec.objects:
        actor = (active.loose if item.dynamic else active.static)[item.name]
        visuals, entity = template_visuals(item.template, item.scale), sapien_object(actor)
        yield RayBody(name=item.name, visuals=visuals, entity=entity, moves=item.dynamic)
    for name, actor in active.pickables.items():
        visuals = template_visuals(templates[name.rsplit("_:", 1)[0]], 1.0)
        yield RayBody(name=name, visuals=visuals, entity=sapien_object(actor))
    for furniture in spec.articulations:
        of_link = furniture_visuals(furniture)
        for link in active.articulations[furniture.name].links:
            name, entity = f"{furniture.name}/{link.name}", sapien_object(link).entity
            yield RayBody(name=name, visuals=of_link[link.name], entity=entity)
    of_link = urdf_visuals(simulated_urdf(agent.spec, visuals=True))
    for link in agent.robot.links:
        if link.name not in hidden:
            name, entity = f"{ROBOT}/{link.name}", sapien_object(link).entity
            yield RayBody(name=name, visuals=of_link[link.name], entity=entity)


class RayCamera(Camera):
    """A depth camera with the parameters of ManiSkill's, but without a renderer."""

    def __init__(self, config: CameraConfig) -> None:
        """Reads the settings; `Camera.__init__` would create a render camera."""
        BaseSensor.__init__(self, config)
        self.config = config
        self.entity = config.mount
        self.local_pose = specified_pose(self)
        self.pinhole = pinhole_of(config)

    def cv_from_world(self) -> np.ndarray:
        """Returns the world's current pose (4, 4) in the camera's frame: x right, y down."""
        return cv_from_world_of(self, self.local_pose)

    def get_params(self) -> dict[str, Tensor]:
        """Returns the current matrices: (1, 3, 4), (1, 4, 4) and (1, 3, 3) float32."""
        intrinsic = np.eye(3)
        intrinsic[[0, 1], [0, 1]] = self.pinhole.focal_px
        intrinsic[:2, 2] = self.pinhole.centre_px
        told = {"intrinsic_cv": torch.from_numpy(intrinsic.astype("f4"))[None]}
        return {**pose_params(self, self.local_pose), **told}


class RaySensors:
    """The sensor cameras of an environment, by name."""

    def __init__(
        self,
        simulation: EpisodeSimulation,
        agent: MobileManipulator,
        cameras: Iterable[CameraConfig],
        changes: Mapping[str, Any],
        hides_arm: bool,
    ) -> None:
        """Mounts cameras, with the `changes` of ManiSkill's `sensor_configs`."""
        configs = {config.uid: config for config in cameras}
        change_cameras(configs, changes)
        self.cameras = {name: RayCamera(config) for name, config in configs.items()}
        self._simulation, self._agent = simulation, agent
        self._hidden = hidden_links(agent.spec) if hides_arm else ()
        self._shown: object = None

    def images(self, wanted: CameraObsTextures) -> Images:
        """Returns the current images in ManiSkill's formats.

        Returns:
            Camera -> ``depth`` (1, H, W, 1) [mm], ``position`` (1, H, W, 3) [mm] with x right, y
            up, z backwards, ``segmentation`` (1, H, W, 1), as wanted; int16, 0 where nothing is.
        """
        # By identity, as there is a new one after every change.
        if self._shown is not self._simulation.shown:
            bodies = visible_bodies(self._simulation, self._agent, self._hidden)
            self._scene = RayScene(list(bodies))
            self._shown = self._simulation.shown
        self._scene.update()
        data = {}
        for name, camera in self.cameras.items():
            pinhole = camera.pinhole
            image = self._scene.image(pinhole, camera.cv_from_world(), wanted.segmentation)
            arrays = _textures(image, pinhole, wanted)
            data[name] = {key: torch.from_numpy(array)[None] for key, array in arrays.items()}
        return data


def pinhole_of(config: CameraConfig) -> Pinhole:
    """Returns ManiSkill's intrinsic parameters; a field of view is the vertical one."""
    size = float(config.width), float(config.height)
    if config.intrinsic is None:
        focal = size[1] / 2.0 / math.tan(config.fov / 2.0)
        focals, centre = (focal, focal), (size[0] / 2.0, size[1] / 2.0)
    else:
        matrix = np.asarray(config.intrinsic, dtype=float).reshape(3, 3)
        focals, centre = (matrix[0, 0], matrix[1, 1]), (matrix[0, 2], matrix[1, 2])
    return Pinhole(
        width_px=int(config.width),
        height_px=int(config.height),
        focal_px=(float(focals[0]), float(focals[1])),
        centre_px=(float(centre[0]), float(centre[1])),
        near_m=float(config.near),
        far_m=float(config.far),
    )


def _textures(image: RayImage, camera: Pinhole, wanted: CameraObsTextures) -> dict[str, np.ndarray]:
    """Returns the requested images of one camera, truncated to millimetres as in the shader."""
    arrays = {}
    depth_mm = image.depth_m * np.float32(1000.0)
    if wanted.depth:
        arrays["depth"] = _whole(depth_mm)[:, :, None]
    if wanted.position:
        # Rays go through the centres of the pixels.
        columns = (np.arange(camera.width_px) + 0.5 - camera.centre_px[0]) / camera.focal_px[0]
        rows = (camera.centre_px[1] - np.arange(camera.height_px) - 0.5) / camera.focal_px[1]
        x, y = depth_mm * columns[None], depth_mm * rows[:, None]
        arrays["position"] = _whole(np.stack((x, y, -depth_mm), axis=-1))
    if wanted.segmentation:
        arrays["segmentation"] = image.actors[:, :, None]
    return arrays


def _whole(millimetres: np.ndarray) -> np.ndarray:
    """Returns the values truncated to int16, as far as it reaches (33 m)."""
    return np.clip(millimetres, -32768.0, 32767.0).astype(np.int16)
