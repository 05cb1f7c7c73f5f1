"""Suite vector: the native vector environment, compared with Gymnasium's AsyncVectorEnv."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
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
from hab_eval.bench.process import Motion, RemoteEnv, StepTiming, engine_clock, read_memory
from hab_eval.bench.reference import Reference, make_layout
from hab_eval.bench.report import REFERENCE, BenchRow, bound_row, make_row
from hab_eval.bench.suite import PICK, TIDY_HOUSE, BenchOptions, Suite, WriteLine
from hab_tasks.envs import ENVS
from hab_tasks.episodes import EpisodeRequest, open_source
from hab_tasks.io.threads import use_one_thread
from hab_tasks.vector.messages import ResetRows, WorkerSetup
from hab_tasks.vector.worker import local_group

MANY_ROWS = 64
MEMORY_BOUND_MB = 1500.0
PHYSICS_SHARE_BOUND = 0.6
NAVIGATE = "HabNavigate-v1"

TWO_IN_ASYNC = "two environments in an AsyncVectorEnv"
TWO_PROCESSES = "two processes that step one environment each"


def run_vector(options: BenchOptions, write_line: WriteLine) -> list[BenchRow]:
    """Measures each environment, then physics share, two processes, memory and ManiSkill."""
    rows: list[BenchRow] = []
    for (scene,) in options.groups:
        for env_id in options.envs or (PICK, TIDY_HOUSE, NAVIGATE):
            with open_case(options, env_id, scene) as case:
                with closing(native(case, ROWS)) as ours, closing(in_async(case)) as other:
                    pairs = _alternate(options, ours, other, write_line)
                rows.append(_steps_row((*case.name, "16_rows"), pairs, TWO_IN_ASYNC))
                rows += _group_rows(options, case, write_line)
        with open_case(options, PICK, scene) as case:
            rows.append(_two_processes(options, case, write_line))
            rows.append(_memory(options, case))
            rows.append(_mani_skill(options, case, write_line))
    return rows


def _alternate(
    options: BenchOptions, ours: Any, other: Any, write_line: WriteLine
) -> list[tuple[float, float]]:
    """Returns steps/s of two vector environments, measured alternately after a warm-up."""
    count = options.step_count
    for env in (ours, other):
        env.reset(seed=0)
        rate(env, max(1, count // 4), 0)
    pairs = []
    for repeat in range(options.repeats):
        # Both sides take about as long: the other has an eighth of the rows.
        pair = (rate(ours, count, repeat), rate(other, 4 * count, repeat))
        pairs.append(pair)
        write_line(f"repeat {repeat + 1}: {pair[0]:.0f} steps/s, reference {pair[1]:.0f}")
    return pairs


def _steps_row(
    name: tuple[str, str, str, str], pairs: Sequence[tuple[float, float]], reference: str
) -> BenchRow:
    ours, others = [a for a, _ in pairs], [b for _, b in pairs]
    return make_row(name, ours, others, unit="steps/s", reference=reference)


def _group_rows(options: BenchOptions, case: Case, write_line: WriteLine) -> list[BenchRow]:
    """Returns physics share and time outside the engine of a worker's rows."""
    with closing(RemoteEnv(partial(GroupLoop, case), {})) as loop:
        loop.run_steps(Motion(count=max(1, options.step_count // 4), seed=0, arm=True))
        timings = [
            loop.run_steps(Motion(count=options.step_count, seed=repeat, arm=True))
            for repeat in range(options.repeats)
        ]
    write_line(
        f"{case.env_id}: {timings[-1].outside_ms:.3f} ms outside the engine per row and step"
    )
    shares = [timing.physics_share for timing in timings]
    outside, engine = [t.outside_ms for t in timings], [t.engine_ms for t in timings]
    return [
        bound_row((*case.name, "16_rows_physics_share"), shares, PHYSICS_SHARE_BOUND, unit="1"),
        make_row(
            (*case.name, "16_rows_outside_physics"),
            outside,
            engine,
            unit="ms/step",
            reference="engine",
        ),
    ]


def _two_processes(options: BenchOptions, case: Case, write_line: WriteLine) -> BenchRow:
    """Returns the row that compares with independent processes."""
    loop, count = partial(SingleLoop, case), options.step_count
    with closing(native(case, ROWS)) as ours:
        others = [RemoteEnv(loop, {}) for _ in range(WORKERS)]
        try:
            ours.reset(seed=0)
            pairs = []
            for repeat in range(options.repeats + 1):
                mine = rate(ours, count, repeat)
                for other in others:
                    other.start_steps(Motion(count=8 * count, seed=repeat, arm=True))
                slowest_s = max(other.finish_steps().total_s for other in others)
                pairs.append((mine, WORKERS * 8 * count / slowest_s))
        finally:
            for other in others:
                other.close()
    write_line(f"two processes: {pairs[-1][0]:.0f} steps/s, reference {pairs[-1][1]:.0f}")
    name = (*case.name, "16_rows_and_two_processes")
    return _steps_row(name, pairs[1:], TWO_PROCESSES)  # the first was the warm-up


def _memory(options: BenchOptions, case: Case) -> BenchRow:
    """Returns the memory of many rows, in all processes together."""
    with closing(native(case, MANY_ROWS)) as env:
        env.reset(seed=0)
        rate(env, min(50, options.step_count), 0)
        pids = (os.getpid(), *env.worker_pids)
        total_mb = sum(read_memory(pid).pss_mb for pid in pids)
    name = (*case.name, "64_rows_pss")
    return bound_row(name, [total_mb], MEMORY_BOUND_MB, unit="MB")


def _mani_skill(options: BenchOptions, case: Case, write_line: WriteLine) -> BenchRow:
    """Returns the row that compares with ManiSkill's scene environment, in an AsyncVectorEnv."""
    count = options.step_count
    with tempfile.TemporaryDirectory(prefix="hab_bench_") as folder:
        make_layout(options.scene_dataset, (case.scene,), Path(folder))
        loop, variables = partial(ReferenceLoop, case.scene), {"MS_ASSET_DIR": folder}
        with (
            closing(RemoteEnv(loop, variables)) as other,
            closing(native(case, ROWS)) as ours,
        ):
            ours.reset(seed=0)
            pairs = []
            for repeat in range(options.repeats + 1):
                theirs = other.run_steps(Motion(count=count, seed=repeat, arm=True))
                pairs.append((rate(ours, count, repeat), theirs.steps_per_s))
    write_line(f"ManiSkill: {pairs[-1][0]:.0f} steps/s, reference {pairs[-1][1]:.0f}")
    name = (*case.name, "16_rows_and_maniskill")
    return _steps_row(name, pairs[1:], f"two of {REFERENCE} in an AsyncVectorEnv")


SUITE = Suite(name="vector", run=run_vector, steps=100, takes_envs=True)


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
        self._envs, self._group, self._actions = local_group(setup)
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
