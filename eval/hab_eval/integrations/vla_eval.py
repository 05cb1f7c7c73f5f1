"""The Home Assistant Benchmark for vla-eval (pip install 'hab-eval[vla-eval]').

``vla_eval.yaml`` beside this module is a configuration for all ten environments.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
import torch
from vla_eval.benchmarks.base import (  # pyright: ignore[reportMissingImports]
    StepBenchmark,
    StepResult,
)
from vla_eval.specs import (  # pyright: ignore[reportMissingImports]
    IMAGE_RGB,
    LANGUAGE,
    DimSpec,
)

from hab_eval.integrations.messages import PROMPT, to_message
from hab_eval.records.config import EMBEDDED_DATASET, MOST_EPISODES, EvalConfig
from hab_eval.run import environments
from hab_eval.run.observations import AgentView
from hab_eval.run.rows import job_of
from hab_tasks.agent import AgentSpec
from hab_tasks.engine.rollout import Outcome, anew
from hab_tasks.envs import ENVS
from hab_tasks.errors import ActionError
from hab_tasks.io.threads import use_one_thread
from hab_tasks.option_values import whole

IMAGE_SIZE_PX = 224


class HabBenchmark(StepBenchmark):
    """Episodes of `hab-eval run`, with the same scenes, seeds and outcomes.

    Args:
        tasks: Environment ids; all of HAB if not given.
        scene_dataset: See `EvalConfig`, as for the next five.
        objects: Folder of the YCB dataset.
        split: Episode split.
        seed: Seed of the episodes.
        novel: Held-out objects or receptacles.
        instructions: ``fixed`` or ``varied``.
        control_mode: Control mode; the environment's first continuous one if not given.
        spec: Other fields of `AgentSpec`, e.g. `obs_mode`, `cameras`, `targets`, `instruction`. By
            default colour images and the instruction, without target positions. A server of
            `hab-eval serve` sets them.
    """

    render_backends = frozenset({"cpu", "gpu"})

    @classmethod
    def configure_render(cls, mode: str) -> dict[str, str]:
        """Returns no variables: the renderer is chosen when images are observed."""
        return {}

    def __init__(
        self,
        tasks: Sequence[str] | None = None,
        *,
        scene_dataset: str = EMBEDDED_DATASET,
        objects: str | None = None,
        split: str | None = None,
        seed: int = 0,
        novel: str | None = None,
        instructions: str = "fixed",
        control_mode: str | None = None,
        obs_mode: str = "rgb",
        target_frame: Any = "base",
        handle_position: bool = False,
        targets: Any = "language",
        instruction: Any = "task",
        cameras: Sequence[str] | None = None,
        camera_size_px: int = IMAGE_SIZE_PX,
        camera_hfov_rad: float = AgentSpec.camera_hfov_rad,
    ) -> None:
        super().__init__()
        use_one_thread()
        self._tasks = [ENVS[name].id for name in (ENVS if tasks is None else tasks)]
        self._data: dict[str, Any] = {
            **{"scene_dataset": scene_dataset, "objects": objects, "split": split, "seed": seed},
            **{"novel": novel, "instructions": instructions},
        }
        self._control_mode = control_mode
        self._spec: dict[str, Any] = {
            **{"name": "vla-eval", "obs_mode": obs_mode, "target_frame": target_frame},
            **{"handle_position": handle_position, "targets": targets, "instruction": instruction},
            **{"cameras": None if cameras is None else tuple(cameras)},
            **{"camera_size_px": camera_size_px, "camera_hfov_rad": camera_hfov_rad},
        }
        self._env_id, self._steps, self._return = "", 0, 0.0
        self._env: gymnasium.Env[Any, Any] | None = None
        self._view = AgentView(AgentSpec(control_mode="", **self._spec))

    def get_tasks(self) -> list[dict[str, Any]]:
        """Returns the environments; the harness sends control mode and size to the server."""
        return [
            {
                "name": name,
                "suite": "skills" if hasattr(ENVS[name].env, "skill") else "tasks",
                "control_mode": self._mode(name),
                "action_size": environments.action_size(self._mode(name)),
            }
            for name in self._tasks
        ]

    def reset(self, task: dict[str, Any]) -> Any:
        """Starts the episode ``task["episode_idx"]`` of the environment ``task["name"]``."""
        index = whole("episode_idx", task.get("episode_idx", 0), 0, MOST_EPISODES)
        env = self._opened(task["name"])
        base: Any = env.unwrapped
        job = job_of(index, base.simulation.source.get(index))
        # The harness sends the task to the server, after this.
        task["seed"] = job.seed
        self._steps, self._return = 0, 0.0
        return self._view(env, anew(env, job)[0])

    def step(self, action: Mapping[str, Any]) -> StepResult:
        """Plays an action (A,), or all actions of a chunk (C, A) until the episode is over."""
        env = self._env
        assert env is not None
        chunk = np.asarray(action.get("actions"))
        chunk = chunk[None] if chunk.ndim == 1 else chunk
        if chunk.ndim != 2 or not len(chunk):
            raise ActionError(f"Actions of shape {list(chunk.shape)}; (A,) or (C, A) is valid.")
        obs: Any = None
        info, over, total = {}, False, 0.0
        for one in torch.from_numpy(chunk).split(1):
            obs, reward, terminated, truncated, info = env.step(one)
            total += float(reward)
            self._steps += 1
            over = bool(terminated) or bool(truncated)
            if over:
                break
        self._return += total
        self._recorder.record_step(reward=total, done=over, success=bool(info["success"]))
        return StepResult(obs=self._view(env, obs), reward=total, done=over, info=dict(info))

    def make_obs(self, raw_obs: Any, task: Mapping[str, Any]) -> dict[str, Any]:
        """Returns images, state and instruction; see `hab_eval.integrations.messages`."""
        return to_message(raw_obs, PROMPT["vla-eval"])

    def get_step_result(self, step_result: StepResult) -> dict[str, Any]:
        """Returns success, stages of a task, steps, return, and the failure if there is one."""
        outcome = Outcome.of(step_result.info, 0, steps=self._steps, episode_return=self._return)
        found: dict[str, Any] = {"success": outcome.success, "env_steps": outcome.steps}
        found |= {"return": outcome.episode_return, **outcome.stages}
        return found | ({"failure": outcome.failure} if outcome.failure else {})

    def get_action_spec(self) -> dict[str, DimSpec]:
        """Returns the size and control mode of actions; docs/contract.md has their entries."""
        mode = self._mode(self._tasks[0])
        size = environments.action_size(mode)
        return {"actions": DimSpec("actions", size, f"hab_{mode}", (-1.0, 1.0))}

    def get_observation_spec(self) -> dict[str, DimSpec]:
        """Returns images, language and state."""
        state = DimSpec("state", 0, f"hab_{self._spec['targets']}")
        return {"image": IMAGE_RGB, "language": LANGUAGE, "state": state}

    def get_metadata(self) -> dict[str, Any]:
        """Returns the longest horizon; each environment ends its episodes at its own."""
        return {"max_steps": max(ENVS[name].horizon_steps for name in self._tasks)}

    def cleanup(self) -> None:
        """Closes the environment."""
        if self._env is not None:
            self._env.close()
        self._env = None

    def _mode(self, env_id: str) -> str:
        return self._control_mode or environments.continuous_control(env_id)

    def _opened(self, env_id: str) -> gymnasium.Env[Any, Any]:
        """Returns the environment; only one is open at a time."""
        if self._env is None or env_id != self._env_id:
            self.cleanup()
            config = EvalConfig(agent="vla_eval", env=env_id, **self._data)
            spec = AgentSpec(control_mode=self._mode(env_id), **self._spec)
            self._env = environments.make_env(config, spec, split=config.split, render=False)
            self._env_id, self._view = env_id, AgentView(spec)
        return self._env
