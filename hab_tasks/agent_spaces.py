"""Spaces and cameras of the environment for an agent, without making the environment.

The space is that of an observation of zeros, by the function that makes an environment's. A test
compares both, and the cameras, for every registered environment.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from hab_tasks.agent import AgentSetup, AgentSpaces, AgentSpec, CameraParameters
from hab_tasks.engine.hab_env import HabEnv
from hab_tasks.engine.ray_sensors import pinhole_of
from hab_tasks.engine.sensors import ObsEntry, observed
from hab_tasks.envs import ENVS
from hab_tasks.errors import OptionError
from hab_tasks.robots.cameras import CameraRig, camera_pose
from hab_tasks.robots.control import control_configs
from hab_tasks.robots.control_modes import action_space
from hab_tasks.robots.spec import RobotSpec, robot_of
from hab_tasks.simulator import convert_observation_to_space, parse_obs_mode_to_struct
from hab_tasks.world.raycast.scene import CV_FROM_SAPIEN

CAMERA_MATRICES = {"extrinsic_cv": (3, 4), "cam2world_gl": (4, 4), "intrinsic_cv": (3, 3)}
"""Shapes of the ``sensor_param`` entries of a camera."""

TEXTURES: dict[str, tuple[int, type[np.generic]]] = {
    "rgb": (3, np.uint8),
    "depth": (1, np.float32),
    "segmentation": (1, np.int16),
    "position": (3, np.int16),
}
"""Channels and dtype of the ``sensor_data`` entries of a camera."""


def agent_setup(
    env_id: str,
    *,
    seed: int = 0,
    options: Mapping[str, str] | None = None,
    device: str = "cpu",
    robot: str | None = None,
) -> AgentSetup:
    """Returns the setup passed to an agent's factory; the id may have a prefix ``hab_tasks:``."""
    return AgentSetup(
        env_id=env_id,
        seed=seed,
        options=dict(options or {}),
        device=device,
        robot=robot,
        spaces_of=partial(agent_spaces, robot=robot),
    )


def agent_spaces(env_id: str, spec: AgentSpec, robot: str | None = None) -> AgentSpaces:
    """Returns the spaces and cameras of environment `env_id` for `spec`.

    `robot` is the uid of another robot than the environment's.

    Raises:
        UnknownNameError: Unknown environment, robot or control mode.
        OptionError: The observation space depends on the scene, as with ``pointcloud``.
    """
    env = ENVS[env_id].env
    own = env.robot if robot is None else robot_of(robot)
    control = control_configs(own)[env.known_mode(spec.control_mode)]
    obs: Any = _state(env, spec, own)
    cameras = {} if spec.obs_mode in ("state", "state_dict") else _cameras(env, spec, own)
    if spec.obs_mode == "state":
        obs = np.concatenate([x for group in obs.values() for x in group.values()], axis=1)
    elif cameras:
        obs |= _images(spec.obs_mode, cameras)
    return AgentSpaces(
        observation=convert_observation_to_space(obs, unbatched=True),
        action=action_space(own, control.arm, control.base),
        cameras=cameras,
    )


def state_entries(env: type[HabEnv], spec: AgentSpec, robot: RobotSpec) -> tuple[ObsEntry, ...]:
    """Returns the entries of the state observation, those of ``agent`` first."""
    options = spec.target_frame, spec.handle_position, spec.targets
    entries = observed(env.observation, env.handle, robot, *options)
    kept = (entry for entry in entries if spec.proprioception or not entry.proprioceptive)
    return tuple(sorted(kept, key=lambda entry: not entry.proprioceptive))


def _state(env: type[HabEnv], spec: AgentSpec, robot: RobotSpec) -> dict[str, dict[str, Any]]:
    """Returns zeros (1, ...) for the non-empty groups of ``agent`` and ``extra``."""
    groups: dict[str, dict[str, Any]] = {"agent": {}, "extra": {}}
    for entry in state_entries(env, spec, robot):
        groups[entry.group][entry.name] = np.zeros((1, *entry.shape), dtype=np.float32)
    return {name: group for name, group in groups.items() if group}


def _images(obs_mode: str, cameras: Mapping[str, CameraParameters]) -> dict[str, Any]:
    """Returns zeros (1, ...) for ``sensor_param`` and ``sensor_data``."""
    asked = vars(parse_obs_mode_to_struct(obs_mode).visual)
    unknown = [name for name, wanted in asked.items() if wanted and name not in TEXTURES]
    if unknown or "pointcloud" in obs_mode or obs_mode in ("none", "sensor_data"):
        modes = f"'state', 'state_dict', or {list(TEXTURES)} joined by '+'"
        raise OptionError.of_value("obs_mode", obs_mode, f"a mode with a fixed space: {modes}")
    matrices = {n: np.zeros((1, *s), dtype=np.float32) for n, s in CAMERA_MATRICES.items()}
    data = {
        name: {
            texture: np.zeros((1, camera.height_px, camera.width_px, channels), dtype=kind)
            for texture, (channels, kind) in TEXTURES.items()
            if asked[texture]
        }
        for name, camera in cameras.items()
    }
    return {"sensor_param": dict.fromkeys(cameras, matrices), "sensor_data": data}


def _cameras(env: type[HabEnv], spec: AgentSpec, robot: RobotSpec) -> dict[str, CameraParameters]:
    """Returns the sensor cameras of an environment, in observation order."""
    names = env.cameras if spec.cameras is None else spec.cameras
    rig = CameraRig.of(robot, names, spec.camera_size_px, spec.camera_hfov_rad)
    unmounted: Any = None
    found = {}
    for config in rig.configs(lambda _: unmounted):
        place, pinhole = robot.cameras[config.uid], pinhole_of(config)
        (fx, fy), (cx, cy) = pinhole.focal_px, pinhole.centre_px
        link_from_camera = camera_pose(place).to_transformation_matrix().astype(np.float64)
        link_from_camera[:3, :3] = link_from_camera[:3, :3] @ CV_FROM_SAPIEN.T
        found[config.uid] = CameraParameters(
            width_px=pinhole.width_px,
            height_px=pinhole.height_px,
            intrinsics_px=np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]),
            link=place.link,
            link_from_camera=link_from_camera,
        )
    return found
