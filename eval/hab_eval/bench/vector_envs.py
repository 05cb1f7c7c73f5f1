"""Vector environments and loops that suite vector measures."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AsyncVectorEnv, AutoresetMode
from mani_skill.utils.wrappers.gymnasium import CPUGymWrapper

from hab_eval.bench.hab_env import control_of
from hab_eval.bench.motion import Motion
from hab_eval.bench.options import BenchOptions
from hab_eval.bench.process import StepTiming, engine_clock
from hab_eval.bench.reference import Reference
from hab_tasks.engine.hab_env import HabEnv
from hab_tasks.envs import ENVS
from hab_tasks.episodes import EpisodeRequest, open_source
from hab_tasks.io.threads import use_one_thread
from hab_tasks.vector.layout import ACTION, ResetRows, WorkerSetup
from hab_tasks.vector.outputs import GroupOutputs
from hab_tasks.vector.workers import StepGroup, joined_rows, layout_of, make_rows

ROWS, WORKERS = 16, 2
EPISODES = 64
"""Size of the episode set that both sides play; generation is measured by suite episodes."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """An environment in a scene, with the same options on both sides.

    Attributes:
        env_id: The environment.
        scene: The scene of all episodes.
        settings: Options of `gymnasium.make`.
    """

    env_id: str
    scene: str
    settings: dict[str, Any]

    @property
    def name(self) -> tuple[str, str, str]:
        """First parts of the names of its rows."""
        return ("vector", self.scene, self.env_id)


@contextmanager
def open_case(options: BenchOptions, env_id: str, scene: str) -> Iterator[Case]:
    """Generates a set of episodes, as before a training run, and yields the case."""
    data: dict[str, Any] = {"scene_dataset": options.scene_dataset, "objects": options.objects}
    with TemporaryDirectory(prefix="hab_bench_") as folder:
        source = open_source(EpisodeRequest(env_id=env_id, scene=scene, **data))
        source.prepare(EPISODES, WORKERS)
        file = source.save(EPISODES, Path(folder) / "episodes.json.gz")
        settings = {name: None if value is None else str(value) for name, value in data.items()}
        settings |= {
            "episodes": str(file),
            "obs_mode": "state",
            "control_mode": control_of(env_id),
            "reward_mode": "dense",
            "render_backend": "none",
        }
        yield Case(env_id=env_id, scene=scene, settings=settings)


def native(case: Case, rows: int) -> Any:
    """Returns a native vector environment."""
    reference = f"hab_tasks:{case.env_id}"
    return gym.make_vec(reference, num_envs=rows, num_workers=WORKERS, **case.settings)


def in_async(case: Case) -> AsyncVectorEnv:
    """Returns two single environments in an AsyncVectorEnv."""
    return AsyncVectorEnv([partial(make_single, case)] * WORKERS, context="spawn")


def make_single(case: Case) -> gym.Env[Any, Any]:
    """Creates one environment in its process, with Gymnasium's single-environment interface."""
    use_one_thread()
    return CPUGymWrapper(gym.make(f"hab_tasks:{case.env_id}", **case.settings))


def make_reference(scene: str) -> gym.Env[Any, Any]:
    """Creates ManiSkill's environment in its process; MS_ASSET_DIR is the copied dataset."""
    use_one_thread()
    return CPUGymWrapper(Reference((scene,), "state").env)


def random_actions(space: Any, count: int, seed: int) -> np.ndarray:
    """Returns uniform actions (count, ...) of a batched action space."""
    rng = np.random.default_rng(seed)
    if hasattr(space, "low"):
        return rng.uniform(space.low, space.high, (count, *space.shape)).astype(space.dtype)
    return np.stack([space.sample() for _ in range(count)])


def rate(env: Any, count: int, seed: int) -> float:
    """Returns the total steps/s of a vector environment; see `Measure`."""
    actions = random_actions(env.action_space, count, seed)
    started = time.perf_counter()
    for action in actions:
        env.step(action)
    return env.num_envs * count / (time.perf_counter() - started)


class SingleLoop:
    """A single environment with random actions that resets itself, in its own process."""

    def __init__(self, case: Case) -> None:
        self._env = make_single(case)
        self._env.reset(seed=0)

    def run_steps(self, motion: Motion) -> StepTiming:
        """Times `motion.count` steps."""
        actions = random_actions(self._env.action_space, motion.count, motion.seed)
        started = time.perf_counter()
        for action in actions:
            _, _, terminated, truncated, _ = self._env.step(action)
            if terminated or truncated:
                self._env.reset()
        total_s = time.perf_counter() - started
        return StepTiming(steps=motion.count, total_s=total_s, engine_s=0.0)

    def close(self) -> None:
        """See `StepsTimed`."""
        self._env.close()


class ReferenceLoop:
    """Two of ManiSkill's environments in an AsyncVectorEnv, with random actions."""

    def __init__(self, scene: str) -> None:
        maker = partial(make_reference, scene)
        self._env = AsyncVectorEnv([maker] * WORKERS, context="spawn")
        self._env.reset(seed=0)

    def run_steps(self, motion: Motion) -> StepTiming:
        """Times `motion.count` steps of both."""
        steps = WORKERS * motion.count
        total_s = steps / rate(self._env, motion.count, motion.seed)
        return StepTiming(steps=steps, total_s=total_s, engine_s=0.0)

    def close(self) -> None:
        """Ends its processes."""
        self._env.close()


class GroupLoop:
    """The rows of one worker in a process of its own, to time the engine within their steps."""

    def __init__(self, case: Case) -> None:
        self._rows = ROWS // WORKERS
        setup = WorkerSetup(
            reference=f"hab_tasks:{case.env_id}",
            options=case.settings,
            group_sizes=(self._rows,),
            max_steps=ENVS[case.env_id].horizon_steps,
            autoreset=AutoresetMode.NEXT_STEP,
        )
        self._envs, self._group, self._actions = _local_group(setup)
        self._group.reset(ResetRows(seeds={row: row for row in range(self._rows)}, options={}))

    def run_steps(self, motion: Motion) -> StepTiming:
        """Times `motion.count` steps of all rows, and the engine in them."""
        space = self._envs[0].single_action_space
        with ExitStack() as clocks:
            durations = [clocks.enter_context(engine_clock(env.scene)) for env in self._envs]
            total_s = 0.0
            for step in range(motion.count):
                drawn = random_actions(space, self._rows, motion.seed * 100_003 + step)
                self._actions[:] = drawn.reshape(self._actions.shape)
                started = time.perf_counter()
                self._group.step()
                total_s += time.perf_counter() - started
        engine_s = sum(map(sum, durations))
        return StepTiming(steps=motion.count * self._rows, total_s=total_s, engine_s=engine_s)

    def close(self) -> None:
        """See `StepsTimed`."""
        for env in self._envs:
            env.close()


def _local_group(setup: WorkerSetup) -> tuple[list[HabEnv], StepGroup, np.ndarray]:
    """Returns a worker's only group in this process: rows, group, actions."""
    envs = make_rows(setup)
    layout, info = layout_of(envs[0]), (("success",),)
    specs = layout.arrays(len(envs), info, final=False)
    arrays = {name: np.zeros(spec.shape, spec.dtype) for name, spec in specs.items()}
    outputs = GroupOutputs(joined_rows(envs), layout, arrays, info, setup.max_steps)
    return envs, StepGroup(envs, outputs, arrays[ACTION], 0, setup), arrays[ACTION]
