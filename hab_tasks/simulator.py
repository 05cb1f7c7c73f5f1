"""ManiSkill's internals: private members, and functions outside its documented interface.

The only module that depends on ManiSkill's version: it supports mani_skill 3.0.1 and
mani_skill-nightly. Other modules import ManiSkill's classes, and its decorators of registration.
"""

from __future__ import annotations

import copy
import inspect
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

from mani_skill.envs.sapien_env import BaseEnv
from mani_skill.envs.utils.observations import parse_obs_mode_to_struct
from mani_skill.envs.utils.system.backend import CPU_SIM_BACKENDS, parse_sim_and_render_backend
from mani_skill.render.shaders import PREBUILT_SHADER_CONFIGS, set_shader_pack
from mani_skill.sensors import camera
from mani_skill.sensors.camera import CameraConfig
from mani_skill.utils.gym_utils import convert_observation_to_space
from mani_skill.utils.registration import REGISTERED_ENVS
from mani_skill.utils.structs.types import SimConfig

__all__ = [
    "CPU_SIM_BACKENDS",
    "INHERITED_OPTIONS",
    "PREBUILT_SHADER_CONFIGS",
    "REGISTERED_ENVS",
    "cameras_by_name",
    "change_cameras",
    "convert_observation_to_space",
    "move_camera",
    "parse_obs_mode_to_struct",
    "parse_sim_and_render_backend",
    "rigid_body",
    "sapien_object",
    "set_shader_pack",
    "set_up",
    "use_settings",
]

INHERITED_OPTIONS = tuple(inspect.signature(BaseEnv.__init__).parameters)[1:]
"""Options of the installed ManiSkill's environments."""

_SENSOR_CHANGES = ("update_sensor_configs_from_dict", "update_camera_configs_from_dict")
_SENSOR_PARSERS = ("parse_sensor_configs", "parse_camera_configs")
"""Names of one function each, the newest first."""


def change_cameras(cameras: dict[str, CameraConfig], changes: Mapping[str, Any]) -> None:
    """Applies ManiSkill's option `sensor_configs` to cameras by name, in place."""
    (change,) = (getattr(camera, name) for name in _SENSOR_CHANGES if hasattr(camera, name))
    # Copied, as ManiSkill's function removes entries from its argument.
    change(cameras, copy.deepcopy(dict(changes)))


def cameras_by_name(cameras: Any) -> dict[str, Any]:
    """Returns one camera, several, or a dict of them, as ManiSkill's classes define them."""
    (parse,) = (getattr(camera, name) for name in _SENSOR_PARSERS if hasattr(camera, name))
    return parse(cameras)


def move_camera(sensor: Any, local_pose: Any) -> None:
    """Moves a sensor camera to a pose in the frame of its mount; its settings stay as they are."""
    # One without a renderer is its own camera.
    rendered = sensor.camera._render_cameras if hasattr(sensor, "camera") else [sensor]
    for each in rendered:
        each.local_pose = local_pose


def use_settings(config: SimConfig) -> None:
    """Applies PhysX settings to bodies and scenes created from now on, as environments do."""
    settings: Any = SimpleNamespace(sim_config=config)
    BaseEnv._set_scene_config(settings)


def sapien_object(wrapped: Any) -> Any:
    """Returns the SAPIEN entity, articulation, link or joint."""
    return wrapped._objs[0]


def rigid_body(actor: Any) -> Any:
    """Returns the rigid body of an actor."""
    return actor._bodies[0]


def set_up(scene: Any) -> None:
    """Sets up a CPU scene without an environment."""
    scene._setup(enable_gpu=False)
