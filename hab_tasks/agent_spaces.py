"""Spaces and cameras of the environment for an agent, without making the environment.

A test compares them with those of every registered environment.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from mani_skill.envs.utils.observations import parse_obs_mode_to_struct

from hab_tasks.agent import AgentSetup, AgentSpaces, AgentSpec, CameraParameters
from hab_tasks.engine.hab_env import HabEnv
from hab_tasks.engine.sensors import observed
from hab_tasks.envs import ENVS
from hab_tasks.errors import OptionError, UnknownNameError
from hab_tasks.robots.cameras import CameraRig, camera_pose
from hab_tasks.robots.control import control_configs
from hab_tasks.robots.control_modes import action_space, nearest_mode

CAMERA_MATRICES = {"extrinsic_cv": (3, 4), "cam2world_gl": (4, 4), "intrinsic_cv": (3, 3)}
"""Shapes of the ``sensor_param`` entries of a camera."""

TEXTURES: dict[str, tuple[int, type[np.generic]]] = {
    "rgb": (3, np.uint8),
    "depth": (1, np.float32),
    "segmentation": (1, np.int16),
    "position": (3, np.int16),
}
"""Channels and dtype of the ``sensor_data`` entries of a camera."""

_OPENCV_FROM_SAPIEN = np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]], dtype=np.float64)
"""SAPIEN's cameras look along x, with z up."""


def agent_setup(
    env_id: str, *, seed: int = 0, options: Mapping[str, str] | None = None, device: str = "cpu"
) -> AgentSetup:
    """Returns the setup passed to an agent's factory.

    Args:
        env_id: Environment id, with or without ``hab_tasks:``.
        seed: The run's seed.
        options: The agent's own options.
        device: Torch device of its networks.
    """
    return AgentSetup(
        env_id=env_id,
        seed=seed,
        options=dict(options or {}),
        device=device,
        spaces_of=agent_spaces,
    )


def agent_spaces(env_id: str, spec: AgentSpec) -> AgentSpaces:
    """Returns the spaces and cameras of environment `env_id` for `spec`.

    Raises:
        UnknownNameError: Unknown environment or control mode.
        OptionError: The observation space depends on the scene, as with ``pointcloud``.
    """
    env = ENVS[env_id].env
    if spec.control_mode not in env.control_modes:
        mode, modes = spec.control_mode, env.control_modes
        raise UnknownNameError(
            f"control_mode of {env.name}", mode, modes, nearest_mode(mode, modes)
        )
    entries = _state_spaces(env, spec)
    if spec.obs_mode == "state":
        size = sum(_size(box) for group in entries.values() for box in group.values())
        observation, cameras = _box((size,)), {}
    elif spec.obs_mode == "state_dict":
        observation, cameras = _nested(entries), {}
    else:
        cameras = _cameras(env)
        observation = _nested({**entries, **_image_spaces(spec.obs_mode, cameras)})
    control = control_configs(env.robot)[spec.control_mode]
    action = action_space(env.robot, control.arm, control.base)
    return AgentSpaces(observation=observation, action=action, cameras=cameras)


def _state_spaces(env: type[HabEnv], spec: AgentSpec) -> dict[str, dict[str, spaces.Space]]:
    """Returns the non-empty groups of ``agent`` and ``extra``."""
    groups: dict[str, dict[str, spaces.Space]] = {"agent": {}, "extra": {}}
    for entry in observed(env.observation, env.handle, spec.target_frame, spec.handle_position):
        groups[entry.group][entry.name] = _box(entry.shape)
    return {name: group for name, group in groups.items() if group}


def _image_spaces(
    obs_mode: str, cameras: Mapping[str, CameraParameters]
) -> dict[str, dict[str, spaces.Space]]:
    """Returns the spaces of ``sensor_param`` and ``sensor_data``."""
    asked = vars(parse_obs_mode_to_struct(obs_mode).visual)
    unknown = [name for name, wanted in asked.items() if wanted and name not in TEXTURES]
    if unknown or "pointcloud" in obs_mode or obs_mode in ("none", "sensor_data"):
        valid = (
            f"a mode with a fixed space: 'state', 'state_dict', or {list(TEXTURES)} joined by '+'"
        )
        raise OptionError.of_value("obs_mode", obs_mode, valid)
    matrices = _nested({name: _box(shape) for name, shape in CAMERA_MATRICES.items()})
    data: dict[str, spaces.Space] = {}
    for name, camera in cameras.items():
        size = camera.height_px, camera.width_px
        data[name] = _nested(
            {texture: _image(*size, *kind) for texture, kind in TEXTURES.items() if asked[texture]}
        )
    return {"sensor_param": dict.fromkeys(cameras, matrices), "sensor_data": data}


def _image(height_px: int, width_px: int, channels: int, kind: Any) -> spaces.Box:
    shape = (height_px, width_px, channels)
    if np.issubdtype(kind, np.floating):
        return _box(shape)
    limits = np.iinfo(kind)
    return spaces.Box(int(limits.min), int(limits.max), shape, kind)


def _cameras(env: type[HabEnv]) -> dict[str, CameraParameters]:
    """Returns the sensor cameras of an environment, in observation order."""
    rig = CameraRig(names=tuple(name for name in env.robot.cameras if name in env.cameras))
    focal_px = rig.size_px / 2 / math.tan(rig.hfov_rad / 2)
    middle_px = rig.size_px / 2
    intrinsics_px = np.array([[focal_px, 0, middle_px], [0, focal_px, middle_px], [0, 0, 1]])
    found = {}
    for name in rig.names:
        place = env.robot.cameras[name]
        link_from_camera = camera_pose(place).to_transformation_matrix().astype(np.float64)
        link_from_camera[:3, :3] = link_from_camera[:3, :3] @ _OPENCV_FROM_SAPIEN.T
        found[name] = CameraParameters(
            width_px=rig.size_px,
            height_px=rig.size_px,
            intrinsics_px=intrinsics_px,
            link=place.link,
            link_from_camera=link_from_camera,
        )
    return found


def _nested(groups: Mapping[str, Any]) -> spaces.Dict:
    parts: dict[str, spaces.Space] = {
        name: value if isinstance(value, spaces.Space) else _nested(value)
        for name, value in groups.items()
    }
    return spaces.Dict(parts)


def _box(shape: tuple[int, ...]) -> spaces.Box:
    return spaces.Box(-np.inf, np.inf, shape, np.float32)


def _size(box: spaces.Space) -> int:
    return math.prod(box.shape or ())
