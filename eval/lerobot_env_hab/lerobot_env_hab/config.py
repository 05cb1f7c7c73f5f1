"""Configuration of the environments, as `lerobot-eval` and `lerobot-train` read it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import gymnasium
from hab_eval.integrations.lerobot import HabLeRobotEnv
from hab_eval.records.config import EMBEDDED_DATASET, EvalConfig
from hab_eval.run import environments
from lerobot.configs.types import (  # pyright: ignore[reportMissingImports]
    FeatureType,
    PolicyFeature,
)
from lerobot.envs.configs import EnvConfig  # pyright: ignore[reportMissingImports]
from lerobot.utils.constants import (  # pyright: ignore[reportMissingImports]
    ACTION,
    OBS_ENV_STATE,
    OBS_IMAGES,
    OBS_STATE,
)

from hab_tasks.agent import AgentSpec
from hab_tasks.constants import CONTROL_HZ
from hab_tasks.envs import ENVS

STATES = {"agent_pos": OBS_STATE, "environment_state": OBS_ENV_STATE}


@EnvConfig.register_subclass("hab")
@dataclass
class HabEnvConfig(EnvConfig):
    """One environment; by default the goal is told by the instruction only.

    Attributes:
        task: Environment id.
        fps: Actions per second.
        control_mode: Control mode; the environment's first continuous one if not given.
        cameras: Names of cameras, separated by commas.
        camera_size_px: Width and height of images.
        targets: ``positions`` adds ``observation.environment_state``.
        instruction: Instruction of the ``task`` or of its current ``stage``.
        instructions: ``fixed`` or ``varied`` wording.
        scene_dataset: ``apartment`` or a ReplicaCAD folder; see `EvalConfig`.
        objects: Folder of the YCB dataset.
        split: Episode split.
        episode_seed: Seed of the episodes; the seed of a reset is the number of one.
    """

    task: str | None = "HabPick-v1"
    fps: int = CONTROL_HZ
    control_mode: str | None = None
    cameras: str = "head,arm"
    camera_size_px: int = 224
    targets: str = "language"
    instruction: str = "task"
    instructions: str = "fixed"
    scene_dataset: str = EMBEDDED_DATASET
    objects: str | None = None
    split: str | None = None
    episode_seed: int = 0
    features: dict[str, PolicyFeature] = field(default_factory=dict)
    features_map: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Describes observations and actions."""
        env = self.make_one()
        spaces: Any = env.observation_space
        kinds = {OBS_STATE: FeatureType.STATE, OBS_ENV_STATE: FeatureType.ENV}
        self._add(ACTION, ACTION, FeatureType.ACTION, env.action_space.shape)
        for name, feature in STATES.items():
            if name in spaces.spaces:
                self._add(name, feature, kinds[feature], spaces[name].shape)
        for camera, space in spaces["pixels"].spaces.items():
            feature = f"{OBS_IMAGES}.{camera}"
            self._add(f"pixels/{camera}", feature, FeatureType.VISUAL, space.shape)

    @property
    def gym_kwargs(self) -> dict[str, Any]:
        """Returns nothing: `create_envs` makes the environments."""
        return {}

    def make_one(self) -> HabLeRobotEnv:
        """Returns an environment; the simulator starts with its first episode."""
        env_id = ENVS[str(self.task)].id
        config = EvalConfig(
            agent="lerobot",
            env=env_id,
            scene_dataset=self.scene_dataset,
            objects=self.objects,
            split=self.split,
            seed=self.episode_seed,
            instructions=self.instructions,
        )
        told: dict[str, Any] = {"targets": self.targets, "instruction": self.instruction}
        spec = AgentSpec(
            name="LeRobot",
            control_mode=self.control_mode or environments.continuous_control(env_id),
            obs_mode="rgb",
            cameras=tuple(self.cameras.split(",")),
            camera_size_px=self.camera_size_px,
            **told,
        )
        return HabLeRobotEnv(config, spec)

    def create_envs(
        self, n_envs: int, use_async_envs: bool = False
    ) -> dict[str, dict[int, gymnasium.vector.VectorEnv[Any, Any, Any]]]:
        """Returns ``{"hab": {0: vector environment}}``, of `n_envs` rows."""
        functions, mode = [self.make_one] * n_envs, gymnasium.vector.AutoresetMode.SAME_STEP
        made: gymnasium.vector.VectorEnv[Any, Any, Any]
        if use_async_envs and n_envs > 1:
            # The simulator does not survive a fork.
            made = gymnasium.vector.AsyncVectorEnv(
                functions, autoreset_mode=mode, context="forkserver"
            )
        else:
            made = gymnasium.vector.SyncVectorEnv(functions, autoreset_mode=mode)
        return {self.type: {0: made}}

    def _add(self, name: str, feature: str, kind: FeatureType, shape: Any) -> None:
        self.features[name] = PolicyFeature(type=kind, shape=tuple(shape))
        self.features_map[name] = feature


def make_env(
    n_envs: int = 1, use_async_envs: bool = False, cfg: HabEnvConfig | None = None
) -> dict[str, dict[int, gymnasium.vector.VectorEnv[Any, Any, Any]]]:
    """Returns the environments of a configuration, for ``env.py`` of a hub repository."""
    return (cfg or HabEnvConfig()).create_envs(n_envs, use_async_envs)
