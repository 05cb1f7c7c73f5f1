"""The reference of the benchmarks: ManiSkill's own scene environment with Fetch in ReplicaCAD."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import torch
from mani_skill.utils.scene_builder.replicacad import ReplicaCADSceneBuilder

from hab_eval.bench_layout import SCENE_SUFFIX
from hab_eval.bench_motion import Motion
from hab_eval.bench_process import Side, StepTiming, time_steps
from hab_tasks.constants import CONTROL_HZ, SIM_HZ

REFERENCE_ENV = "ReplicaCAD_SceneManipulation-v1"
REFERENCE_CONTROL = "pd_ee_delta_pos"
REFERENCE_EE_STEP_M = 0.1
"""Displacement of the end-effector for an action entry of 1 in `pd_ee_delta_pos`."""

REFERENCE_BASE_SPEEDS = (1.0, 3.14)
"""Forward [m/s] and turning velocity [rad/s] of the base for action entries of 1."""

SETTLE_STEPS = 10 * SIM_HZ
"""Ten seconds: the loose objects fall and come to rest, as ours are when a scene is loaded."""


@dataclass(frozen=True, kw_only=True)
class ReferenceFactory:
    """Makes the reference in its process; MS_ASSET_DIR must name the copied dataset there.

    Attributes:
        scenes: Scene ids; the first is where steps and soft resets are measured.
        obs_mode: ManiSkill observation mode.
    """

    scenes: tuple[str, ...]
    obs_mode: str

    def __call__(self) -> Side:
        """Builds the environment."""
        return Reference(self.scenes, self.obs_mode)


class Reference:
    """ManiSkill's environment behind the `Side` protocol."""

    def __init__(self, scenes: tuple[str, ...], obs_mode: str) -> None:
        class ListedScenes(ReplicaCADSceneBuilder):
            """Knows the scenes asked for; ManiSkill's own list lacks some of the dataset's."""

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
            # Its scene builder adds lights unconditionally, which needs a renderer.
            render_backend="cpu",
        )
        self._scene_count = len(scenes)
        self._scene = 0
        self._env.reset(seed=0)
        self._start = self._settled_state()

    def run_steps(self, motion: Motion) -> StepTiming:
        """See `Side`."""
        self._env.unwrapped.set_state_dict(self._start)
        self._env.unwrapped.agent.controller.reset()
        # Gripper and body, between arm and base, stay still.
        actions = torch.zeros(motion.count, self._env.action_space.shape[-1])
        actions[:, :3] = motion.arm_steps_m() / REFERENCE_EE_STEP_M
        actions[:, -2:] = motion.base_speeds() / torch.tensor(REFERENCE_BASE_SPEEDS)
        return time_steps(self._env, torch.zeros_like(actions[0]), actions)

    def soft_reset(self) -> float:
        """See `Side`."""
        started = time.perf_counter()
        self._env.reset()
        return time.perf_counter() - started

    def layouts(self) -> int:
        """See `Side`."""
        return self._scene_count

    def other_layout(self) -> float:
        """See `Side`."""
        self._scene = (self._scene + 1) % self._scene_count
        options = {"reconfigure": True, "build_config_idxs": [self._scene]}
        started = time.perf_counter()
        self._env.reset(seed=0, options=options)
        return time.perf_counter() - started

    def close(self) -> None:
        """See `Side`."""
        self._env.close()

    def _settled_state(self) -> Any:
        """Lets the loose objects come to rest and returns the state."""
        scene = self._env.unwrapped.scene
        for _ in range(SETTLE_STEPS):
            scene.step()
        return self._env.unwrapped.get_state_dict()
