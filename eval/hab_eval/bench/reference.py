"""The benchmarks' reference: ManiSkill's own scene environment with Fetch in ReplicaCAD."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import torch
from mani_skill.utils.scene_builder.replicacad import ReplicaCADSceneBuilder

from hab_eval.bench.layout import SCENE_SUFFIX
from hab_eval.bench.motion import Motion
from hab_eval.bench.process import BenchEnv, StepTiming, time_steps
from hab_tasks.constants import CONTROL_HZ, SIM_HZ

REFERENCE_ENV = "ReplicaCAD_SceneManipulation-v1"
REFERENCE_CONTROL = "pd_ee_delta_pos"
REFERENCE_EE_STEP_M = 0.1
"""Displacement of the end-effector for an action entry of 1 in `pd_ee_delta_pos`."""

REFERENCE_BASE_SPEEDS = (1.0, 3.14)
"""Forward [m/s] and turning velocity [rad/s] of the base for action entries of 1."""

SETTLE_STEPS = 10 * SIM_HZ
"""Ten seconds, in which the loose objects fall and settle; `hab_tasks` does this at scene load."""


@dataclass(frozen=True, kw_only=True)
class ReferenceFactory:
    """Creates the reference in its process, where MS_ASSET_DIR must be the copied dataset.

    Attributes:
        scenes: Scene ids; steps and soft resets are measured in the first.
        obs_mode: ManiSkill observation mode.
    """

    scenes: tuple[str, ...]
    obs_mode: str

    def __call__(self) -> BenchEnv:
        """Builds the environment."""
        return Reference(self.scenes, self.obs_mode)


class Reference:
    """ManiSkill's environment with the `BenchEnv` protocol."""

    def __init__(self, scenes: tuple[str, ...], obs_mode: str) -> None:
        class ListedScenes(ReplicaCADSceneBuilder):
            """Builds the requested scenes; ManiSkill's own list is incomplete."""

            def __init__(self, env: Any) -> None:
                super().__init__(env)
                self.build_configs = [f"{scene}{SCENE_SUFFIX}" for scene in scenes]
                self._navigable_positions = [None] * len(scenes)

        self._env: Any = gym.make(
            REFERENCE_ENV,
            scene_builder_cls=ListedScenes,
            build_config_idxs=[0],
            robot_uids="fetch",
            obs_mode=obs_mode,
            control_mode=REFERENCE_CONTROL,
            sim_config={"sim_freq": SIM_HZ, "control_freq": CONTROL_HZ},
            reconfiguration_freq=0,
            # The scene builder always adds lights, which needs a renderer.
            render_backend="cpu",
        )
        self._scene_count = len(scenes)
        self._scene = 0
        self._env.reset(seed=0)
        self._start = self._settled_state()

    @property
    def env(self) -> Any:
        """The environment."""
        return self._env

    def run_steps(self, motion: Motion) -> StepTiming:
        """See `BenchEnv`."""
        self._env.unwrapped.set_state_dict(self._start)
        self._env.unwrapped.agent.controller.reset()
        # The entries of gripper and body, between arm and base, stay zero.
        actions = torch.zeros(motion.count, self._env.action_space.shape[-1])
        actions[:, :3] = motion.arm_steps_m() / REFERENCE_EE_STEP_M
        actions[:, -2:] = motion.base_speeds() / torch.tensor(REFERENCE_BASE_SPEEDS)
        return time_steps(self._env, torch.zeros_like(actions[0]), actions)

    def soft_reset(self) -> float:
        """See `BenchEnv`."""
        started = time.perf_counter()
        self._env.reset()
        return time.perf_counter() - started

    def layouts(self) -> int:
        """See `BenchEnv`."""
        return self._scene_count

    def other_layout(self) -> float:
        """See `BenchEnv`."""
        self._scene = (self._scene + 1) % self._scene_count
        options = {"reconfigure": True, "build_config_idxs": [self._scene]}
        started = time.perf_counter()
        self._env.reset(seed=0, options=options)
        return time.perf_counter() - started

    def close(self) -> None:
        """See `BenchEnv`."""
        self._env.close()

    def _settled_state(self) -> Any:
        """Lets the loose objects settle and returns the state."""
        scene = self._env.unwrapped.scene
        for _ in range(SETTLE_STEPS):
            scene.step()
        return self._env.unwrapped.get_state_dict()
