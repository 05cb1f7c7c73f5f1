"""Benchmarked environment of `hab_tasks`, in scenes of the real ReplicaCAD."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import torch
from torch import Tensor

from hab_eval.bench.process import BenchEnv, Motion, StepTiming, time_steps
from hab_eval.bench.suite import BenchOptions
from hab_tasks.constants import EE_STEP_M, REST_POSITION_M
from hab_tasks.envs import ENVS
from hab_tasks.episodes import Episode, EpisodeRequest, load_episodes

CONTROLS = ("ee", "ee_base", "base")
"""An environment is measured in the first of these that it supports."""

EPISODES_IN_SCENE = 2
"""Two, because a soft reset goes to another episode of the same scene."""

EPISODES_TO_CHOOSE_FROM = 8

RELEASE, HOLD = -1.0, 1.0
"""Gripper entries: never grasp, or keep the object that is held at the start."""


@dataclass(frozen=True, kw_only=True)
class HabEnvFactory:
    """Creates an environment of `hab_tasks` in its process.

    Attributes:
        env_id: Environment id.
        scene_dataset: The ReplicaCAD folder.
        objects: A YCB folder, None for the shipped objects.
        scenes: Scene ids; steps and soft resets are measured in the first.
        obs_mode: ManiSkill observation mode.
        render_backend: ``none``, or ``rays`` or ``cpu`` to measure images.
        episodes: Episodes of the first scene; empty for generated episodes.
    """

    env_id: str
    scene_dataset: str
    objects: str | None
    scenes: tuple[str, ...]
    obs_mode: str = "state_dict"
    render_backend: str = "none"
    episodes: tuple[Episode, ...] = ()

    @classmethod
    def of(
        cls, options: BenchOptions, env_id: str, scenes: tuple[str, ...], **settings: Any
    ) -> HabEnvFactory:
        """Returns the factory of an environment for the options' datasets."""
        return cls(
            env_id=env_id,
            scene_dataset=str(options.scene_dataset),
            objects=None if options.objects is None else str(options.objects),
            scenes=scenes,
            **settings,
        )

    def __call__(self) -> BenchEnv:
        """Builds the environment."""
        return HabBenchEnv(self)

    def make_env(self) -> Any:
        """Creates the environment."""
        return gym.make(
            f"hab_tasks:{self.env_id}",
            num_envs=1,
            scene_dataset=self.scene_dataset,
            objects=self.objects,
            # In a single scene, loose objects start where they settled in episode generation.
            scene=self.scenes[0] if len(self.scenes) == 1 else None,
            obs_mode=self.obs_mode,
            control_mode=control_of(self.env_id),
            reward_mode="dense",
            render_backend=self.render_backend,
        )

    def episodes_in(self, scene: str) -> tuple[Episode, ...]:
        """Returns the episodes of one scene whose hand starts farthest from all objects.

        The motions should not hit objects; the reference's robot stands in the middle of the room.
        """
        if self.episodes:
            return self.episodes
        request = EpisodeRequest(
            env_id=self.env_id, scene_dataset=self.scene_dataset, objects=self.objects, scene=scene
        )
        episodes = load_episodes(request, EPISODES_TO_CHOOSE_FROM).episodes
        return tuple(sorted(episodes, key=_clearance_m, reverse=True)[:EPISODES_IN_SCENE])


class HabBenchEnv:
    """An environment of `hab_tasks` with the `BenchEnv` protocol."""

    def __init__(self, factory: HabEnvFactory) -> None:
        self._episodes = [factory.episodes_in(scene) for scene in factory.scenes]
        self._env_id = factory.env_id
        self._scene = 0
        self._episode = 0
        self._env = factory.make_env()
        self._reset(reconfigure=True)

    def run_steps(self, motion: Motion) -> StepTiming:
        """See `BenchEnv`."""
        self._reset(reconfigure=False)
        episode = self._episodes[self._scene][self._episode]
        still = Motion(count=1, seed=0, arm=False)
        idle = actions_of(self._env_id, still, episode)[0]
        return time_steps(self._env, idle, actions_of(self._env_id, motion, episode))

    def soft_reset(self) -> float:
        """See `BenchEnv`."""
        self._episode = (self._episode + 1) % len(self._episodes[self._scene])
        return self._reset(reconfigure=False)

    def other_layout(self) -> float:
        """See `BenchEnv`."""
        self._scene = (self._scene + 1) % len(self._episodes)
        return self._reset(reconfigure=False)

    def layouts(self) -> int:
        """See `BenchEnv`."""
        return len(self._episodes)

    def close(self) -> None:
        """See `BenchEnv`."""
        self._env.close()

    def _reset(self, *, reconfigure: bool) -> float:
        """Times a reset to the current episode [s]."""
        episode = self._episodes[self._scene][self._episode]
        options = {"episode": episode, "reconfigure": reconfigure}
        started = time.perf_counter()
        self._env.reset(seed=episode.seed, options=options)
        return time.perf_counter() - started


def control_of(env_id: str) -> str:
    """Returns the control mode with which an environment is measured."""
    modes = ENVS[env_id].env.control_modes
    return next(mode for mode in CONTROLS if mode in modes)


def motion_of(control: str, count: int, seed: int) -> Motion:
    """Returns motions of the joints that a control mode actuates."""
    arm, base = control.startswith("ee"), control.endswith("base")
    return Motion(count=count, seed=seed, arm=arm, base=base)


def actions_of(env_id: str, motion: Motion, episode: Episode) -> Tensor:
    """Returns the actions (count, A) of a motion; an object held at the start stays held."""
    control, robot, parts = control_of(env_id), ENVS[env_id].env.robot, []
    if control.startswith("ee"):
        gripper = RELEASE if episode.held is None else HOLD
        parts += [motion.arm_steps_m() / EE_STEP_M, torch.full((motion.count, 1), gripper)]
    if control.endswith("base"):
        largest = torch.tensor([robot.base_linear_speed_m_s, robot.base_angular_speed_rad_s])
        parts.append(motion.base_speeds() / largest)
    return torch.cat(parts, dim=1)


def _clearance_m(episode: Episode) -> float:
    """Returns the distance from the resting hand to the nearest object at the start [m]."""
    x, y, yaw = episode.robot.base
    ahead, left, height = REST_POSITION_M
    hand = (
        x + ahead * math.cos(yaw) - left * math.sin(yaw),
        y + ahead * math.sin(yaw) + left * math.cos(yaw),
        height,
    )
    objects = [pose for name, pose in episode.objects.items() if name != episode.held]
    poses = [*objects, *episode.loose.values()]
    return min((math.dist(hand, pose[:3]) for pose in poses), default=math.inf)
