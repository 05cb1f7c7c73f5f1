"""Our side of the benchmarks: HabPick-v1 in a scene of the real ReplicaCAD."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import torch

from hab_eval.bench_process import Side, StepTiming, arm_steps_m, time_steps
from hab_tasks.constants import EE_STEP_M, REST_POSITION_M
from hab_tasks.episodes import Episode, EpisodeRequest, load_episodes

ENV_ID = "HabPick-v1"
CONTROL = "ee"
EPISODES_IN_SCENE = 2
"""A soft reset goes to another episode of the same scene, so there must be two."""

EPISODES_TO_CHOOSE_FROM = 8

RELEASE = -1.0
"""Gripper entry that grasps nothing."""


@dataclass(frozen=True, kw_only=True)
class OursFactory:
    """Makes our environment in its process.

    Attributes:
        scene_dataset: The ReplicaCAD folder.
        objects: A YCB folder, None for the shipped objects.
        scenes: Scene ids; the first is where steps and soft resets are measured.
        obs_mode: ManiSkill observation mode.
        render_backend: ``none``, or ``cpu`` where images are measured.
    """

    scene_dataset: str
    objects: str | None
    scenes: tuple[str, ...]
    obs_mode: str
    render_backend: str

    def __call__(self) -> Side:
        """Builds the environment."""
        return Ours(self)


class Ours:
    """Our environment behind the `Side` protocol."""

    def __init__(self, factory: OursFactory) -> None:
        self._episodes = [_episodes_in(factory, scene) for scene in factory.scenes]
        self._scene = 0
        self._episode = 0
        self._env: Any = gym.make(
            f"hab_tasks:{ENV_ID}",
            num_envs=1,
            scene_dataset=factory.scene_dataset,
            objects=factory.objects,
            # One scene: its loose objects start where they settled when its episodes were made.
            scene=factory.scenes[0] if len(factory.scenes) == 1 else None,
            obs_mode=factory.obs_mode,
            control_mode=CONTROL,
            reward_mode="dense",
            render_backend=factory.render_backend,
        )
        self._reset(reconfigure=True)

    def run_steps(self, count: int, seed: int) -> StepTiming:
        """See `Side`."""
        self._reset(reconfigure=False)
        actions = torch.zeros(count, self._env.action_space.shape[-1])
        actions[:, :3] = arm_steps_m(count, seed) / EE_STEP_M
        actions[:, 3] = RELEASE
        idle = torch.zeros_like(actions[0])
        idle[3] = RELEASE
        return time_steps(self._env, idle, actions)

    def soft_reset(self) -> float:
        """See `Side`."""
        self._episode = (self._episode + 1) % EPISODES_IN_SCENE
        return self._reset(reconfigure=False)

    def other_layout(self) -> float:
        """See `Side`."""
        self._scene = (self._scene + 1) % len(self._episodes)
        return self._reset(reconfigure=False)

    def layouts(self) -> int:
        """See `Side`."""
        return len(self._episodes)

    def close(self) -> None:
        """See `Side`."""
        self._env.close()

    def _reset(self, *, reconfigure: bool) -> float:
        """Times a reset to the chosen episode [s]."""
        episode = self._episodes[self._scene][self._episode]
        options = {"episode": episode, "reconfigure": reconfigure}
        started = time.perf_counter()
        self._env.reset(seed=episode.seed, options=options)
        return time.perf_counter() - started


def _episodes_in(factory: OursFactory, scene: str) -> tuple[Episode, ...]:
    """Returns the episodes of one scene whose hand starts farthest from any object.

    The reference's robot stands in the middle of the room; the motions of a benchmark should push
    nothing over here either.
    """
    request = EpisodeRequest(
        env_id=ENV_ID, scene_dataset=factory.scene_dataset, objects=factory.objects, scene=scene
    )
    episodes = load_episodes(request, EPISODES_TO_CHOOSE_FROM).episodes
    return tuple(sorted(episodes, key=_clearance_m, reverse=True)[:EPISODES_IN_SCENE])


def _clearance_m(episode: Episode) -> float:
    """Distance [m] from the resting hand to the nearest object at the episode's start."""
    x, y, yaw = episode.robot.base
    ahead, left, height = REST_POSITION_M
    hand = (
        x + ahead * math.cos(yaw) - left * math.sin(yaw),
        y + ahead * math.sin(yaw) + left * math.cos(yaw),
        height,
    )
    poses = [*episode.objects.values(), *episode.loose.values()]
    return min(math.dist(hand, pose[:3]) for pose in poses)
