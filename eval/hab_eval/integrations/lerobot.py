"""An environment with LeRobot's observations, attributes and `info`, for `lerobot_env_hab`."""

from __future__ import annotations

from typing import Any, ClassVar

import gymnasium
import numpy as np
import torch
from gymnasium import spaces

from hab_eval.records.config import EvalConfig
from hab_eval.run import environments
from hab_eval.run.observations import AgentView
from hab_eval.run.rows import job_of
from hab_tasks.agent import AgentSpec
from hab_tasks.agent_spaces import agent_spaces
from hab_tasks.arrays import Floats
from hab_tasks.constants import CONTROL_HZ
from hab_tasks.engine.rollout import anew
from hab_tasks.envs import ENVS


class HabLeRobotEnv(gymnasium.Env[dict[str, Any], Any]):
    """Episodes of `hab-eval run`; the seed of a reset is the number of the episode.

    Attributes:
        task: The environment's id.
        task_description: Instruction of the episode, or of its current stage.
    """

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        "render_modes": ["rgb_array"],
        "render_fps": CONTROL_HZ,
    }
    render_mode = "rgb_array"

    def __init__(self, config: EvalConfig, spec: AgentSpec) -> None:
        """Takes the episodes, and the observations and actions."""
        self.task, self.task_description = config.env, ""
        self._max_episode_steps = ENVS[config.env].horizon_steps
        self._config, self._spec, self._number = config, spec, -1
        self._view = AgentView(spec)
        self._env: Any = None
        self._pixels: dict[str, Any] = {}
        self.observation_space = spaces.Dict(observed_spaces(config.env, spec))
        self.action_space = agent_spaces(config.env, spec).action

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Starts episode number `seed`, or the next one without a seed."""
        super().reset(seed=seed)
        if self._env is None:  # only of the task that is evaluated, in the process that steps it
            config = self._config
            self._env = environments.make_env(config, self._spec, split=config.split, render=False)
        self._number = self._number + 1 if seed is None else seed
        source = self._env.unwrapped.simulation.source
        obs, _ = anew(self._env, job_of(self._number, source.get(self._number)))
        return self._observed(obs), {"is_success": False}

    def step(self, action: Any) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Plays an action (A,)."""
        batch = torch.as_tensor(np.asarray(action, dtype=np.float32))[None]
        obs, reward, terminated, truncated, info = self._env.step(batch)
        told = {"is_success": bool(info["success"])}
        return self._observed(obs), float(reward), bool(terminated), bool(truncated), told

    def render(self) -> Any:
        """Returns the images of the cameras side by side."""
        return np.concatenate(list(self._pixels.values()), axis=1)

    def close(self) -> None:
        """Frees the simulator."""
        if self._env is not None:
            self._env.close()
        self._env = None

    def _observed(self, raw: Any) -> dict[str, Any]:
        seen = self._view(self._env, raw)
        self.task_description = seen["instruction"][0]
        cameras = seen["sensor_data"]
        self._pixels = {name: images["rgb"][0].numpy() for name, images in cameras.items()}
        found: dict[str, Any] = {"pixels": self._pixels, "agent_pos": _flat(seen["agent"])}
        if "extra" in seen:
            found["environment_state"] = _flat(seen["extra"])
        return found


def observed_spaces(env_id: str, spec: AgentSpec) -> dict[str, spaces.Space[Any]]:
    """Returns the spaces of LeRobot's observations: images by camera, state, target positions."""
    groups: Any = agent_spaces(env_id, spec).observation
    found: dict[str, spaces.Space[Any]] = {}
    for group, name in (("agent", "agent_pos"), ("extra", "environment_state")):
        if group in groups.spaces:
            size = sum(int(np.prod(one.shape)) for one in groups[group].spaces.values())
            found[name] = spaces.Box(-np.inf, np.inf, (size,), np.float32)
    pixels: dict[str, spaces.Space[Any]] = {}
    for camera, images in groups["sensor_data"].spaces.items():
        pixels[camera] = spaces.Box(0, 255, images["rgb"].shape, np.uint8)
    return {"pixels": spaces.Dict(pixels), **found}


def _flat(group: Any) -> Floats:
    return np.concatenate([value[0].reshape(-1).numpy() for value in group.values()])
