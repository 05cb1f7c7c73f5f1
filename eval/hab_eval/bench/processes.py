"""Suite processes: environments in separate processes, independent or in an AsyncVectorEnv."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import partial
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from gymnasium.vector import AsyncVectorEnv, AutoresetMode
from mani_skill.utils.wrappers.gymnasium import CPUGymWrapper

from hab_eval.bench.hab_env import HabEnvFactory, actions_of, control_of, motion_of
from hab_eval.bench.options import BenchOptions
from hab_eval.bench.process import RemoteEnv
from hab_eval.bench.rows import BenchRow, make_row
from hab_eval.bench.suite import PICK, Suite, WriteLine
from hab_eval.errors import BenchError
from hab_tasks.processes import use_one_thread

CONTEXT = "spawn"
"""Start method of the processes; threads do not survive a fork."""

ONE, TWO = "one process", "two processes"


class Vector(Protocol):
    """Environments in separate processes."""

    def run_steps(self, count: int, seed: int) -> float:
        """Resets all environments and steps each `count` times; returns their total steps/s."""
        ...

    def pids(self) -> tuple[int, ...]:
        """Returns the process ids of the environments."""
        ...

    def close(self) -> None:
        """Ends the processes."""
        ...


class SeparateProcesses:
    """Copies of an environment in independent, unsynchronized processes, as in an evaluation."""

    def __init__(self, options: BenchOptions, env_id: str, scene: str, count: int) -> None:
        """Starts `count` processes."""
        factory, self._control, _ = _factory(options, env_id, scene)
        self._envs = [RemoteEnv(factory, {}) for _ in range(count)]

    def run_steps(self, count: int, seed: int) -> float:
        """See `Vector`; the slowest process determines the time."""
        for env in self._envs:
            env.start_steps(motion_of(self._control, count, seed))
        timings = [env.finish_steps() for env in self._envs]
        return len(timings) * count / max(timing.total_s for timing in timings)

    def pids(self) -> tuple[int, ...]:
        """See `Vector`."""
        return tuple(env.pid for env in self._envs)

    def close(self) -> None:
        """See `Vector`."""
        for env in self._envs:
            env.close()


class VectorEnv:
    """Copies of an environment in one AsyncVectorEnv, with state observations."""

    def __init__(self, options: BenchOptions, env_id: str, scene: str, count: int) -> None:
        """Starts `count` processes."""
        factory, self._control, self._episode = _factory(options, env_id, scene)
        with _reporting_lost_processes():
            self._env = AsyncVectorEnv(
                [partial(_make, factory)] * count,
                context=CONTEXT,
                autoreset_mode=AutoresetMode.DISABLED,
            )

    def run_steps(self, count: int, seed: int) -> float:
        """See `Vector`."""
        size = self._env.num_envs
        motion = motion_of(self._control, count, seed)
        actions = actions_of(self._control, motion, self._episode).numpy()
        together = np.repeat(actions[:, None], size, axis=1)
        with _reporting_lost_processes():
            self._env.reset(seed=self._episode.seed, options={"episode": self._episode})
            started = time.perf_counter()
            for action in together:
                self._env.step(action)
            return size * count / (time.perf_counter() - started)

    def pids(self) -> tuple[int, ...]:
        """See `Vector`."""
        return tuple(int(process.pid or 0) for process in self._env.processes)

    def close(self) -> None:
        """See `Vector`."""
        self._env.close()


def _factory(options: BenchOptions, env_id: str, scene: str) -> tuple[Any, str, Any]:
    """Returns the factory of an environment, its control mode and its episode."""
    factory = HabEnvFactory.of(options, env_id, (scene,), obs_mode="state")
    return factory, control_of(env_id), factory.episodes_in(scene)[0]


@contextmanager
def _reporting_lost_processes() -> Iterator[None]:
    """Reports the end of a process, of which Gymnasium only reports a closed pipe."""
    try:
        yield
    except (EOFError, ConnectionError) as error:
        raise BenchError("A process of the vector environment ended; see above.") from error


def _make(factory: Any) -> gym.Env[Any, Any]:
    """Creates one environment in its process, with Gymnasium's single-environment interface."""
    use_one_thread()
    return CPUGymWrapper(factory.make_env())


VECTORS: dict[str, Callable[[BenchOptions, str, str, int], Vector]] = {
    "two_processes": SeparateProcesses,
    "two_in_vector_env": VectorEnv,
}
"""Variants of stepping two environments in parallel."""


def run_processes(options: BenchOptions, write_line: WriteLine) -> list[BenchRow]:
    """Compares HabPick-v1 in two processes with one, for each scene and variant."""
    rows: list[BenchRow] = []
    for (scene,) in options.groups:
        for variant, make in VECTORS.items():
            with (
                closing(make(options, PICK, scene, 1)) as one,
                closing(make(options, PICK, scene, 2)) as two,
            ):
                write_line(f"suite processes, scene {scene}, {variant}: three processes are ready")
                pairs = alternate(options, one, two, write_line)
            rows.append(process_row(("processes", scene, PICK, variant), pairs))
    return rows


def alternate(
    options: BenchOptions, one: Vector, two: Vector, write_line: WriteLine
) -> list[tuple[float, float]]:
    """Returns steps/s of one and of two processes, measured alternately after a warm-up."""
    count = options.step_count
    for vector in (one, two):
        vector.run_steps(count, 0)
    pairs = []
    for repeat in range(options.repeats):
        pairs.append((one.run_steps(count, repeat), two.run_steps(count, repeat)))
        shown = f"{ONE} {pairs[-1][0]:.1f} steps/s, {TWO} {pairs[-1][1]:.1f}"
        write_line(f"repeat {repeat + 1} of {options.repeats}: {shown}")
    return pairs


def process_row(name: tuple[str, str, str, str], pairs: Sequence[tuple[float, float]]) -> BenchRow:
    """Returns the row that compares two processes with one; its ratio is the speed-up."""
    ones, twos = [a for a, _ in pairs], [b for _, b in pairs]
    return make_row(name, twos, ones, unit="steps/s", reference=ONE)


SUITE = Suite(name="processes", run=run_processes, steps=1000)
