"""Environments in processes of their own, each by itself or in an AsyncVectorEnv."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import partial
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from gymnasium.vector import AsyncVectorEnv, AutoresetMode

from hab_eval.bench_options import PICK, BenchOptions, WriteLine
from hab_eval.bench_process import RemoteSide
from hab_eval.bench_rows import BenchRow, make_row
from hab_eval.errors import BenchError

CONTEXT = "spawn"
"""How the processes are started: threads and forks do not mix."""

ONE, TWO = "one process", "two processes"


class Vector(Protocol):
    """Environments in processes of their own."""

    def run_steps(self, count: int, seed: int) -> float:
        """Resets all, then steps them `count` times together; returns steps/s of all of them."""
        ...

    def pids(self) -> tuple[int, ...]:
        """Returns the process ids of the environments."""
        ...

    def close(self) -> None:
        """Ends the processes."""
        ...


class Apart:
    """One of our environments several times; nobody waits for the others, as in an evaluation."""

    def __init__(self, options: BenchOptions, env_id: str, scene: str, count: int) -> None:
        """Starts `count` processes."""
        factory, self._control, _ = _ours(options, env_id, scene)
        self._sides = [RemoteSide(factory, {}) for _ in range(count)]

    def run_steps(self, count: int, seed: int) -> float:
        """See `Vector`; the slowest tells how long it took."""
        from hab_eval.bench_ours import motion_of

        for side in self._sides:
            side.start_steps(motion_of(self._control, count, seed))
        timings = [side.finish_steps() for side in self._sides]
        return len(timings) * count / max(timing.total_s for timing in timings)

    def pids(self) -> tuple[int, ...]:
        """See `Vector`."""
        return tuple(side.pid for side in self._sides)

    def close(self) -> None:
        """See `Vector`."""
        for side in self._sides:
            side.close()


class VectorEnv:
    """One of our environments several times, in one AsyncVectorEnv, on state observations."""

    def __init__(self, options: BenchOptions, env_id: str, scene: str, count: int) -> None:
        """Starts `count` processes."""
        factory, self._control, self._episode = _ours(options, env_id, scene)
        with _losses_told():
            self._env = AsyncVectorEnv(
                [partial(_make, factory)] * count,
                context=CONTEXT,
                autoreset_mode=AutoresetMode.DISABLED,
            )

    def run_steps(self, count: int, seed: int) -> float:
        """See `Vector`."""
        from hab_eval.bench_ours import motion_of, our_actions

        size = self._env.num_envs
        motion = motion_of(self._control, count, seed)
        actions = our_actions(self._control, motion, self._episode).numpy()
        together = np.repeat(actions[:, None], size, axis=1)
        with _losses_told():
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


def _ours(options: BenchOptions, env_id: str, scene: str) -> tuple[Any, str, Any]:
    """Returns what makes our environment, its control mode, and the episode it plays."""
    from hab_eval.bench_ours import OursFactory, control_of

    factory = OursFactory.of(options, env_id, (scene,), obs_mode="state")
    return factory, control_of(env_id), factory.episodes_in(scene)[0]


@contextmanager
def _losses_told() -> Iterator[None]:
    """Tells that a process ended, where Gymnasium only finds its pipe closed."""
    try:
        yield
    except (EOFError, ConnectionError) as error:
        raise BenchError("A process of the vector environment ended; see above.") from error


def _make(factory: Any) -> gym.Env[Any, Any]:
    """Makes one environment, in its process, as plain Gymnasium wants it."""
    from mani_skill.utils.wrappers.gymnasium import CPUGymWrapper

    from hab_tasks.processes import use_one_thread

    use_one_thread()
    return CPUGymWrapper(factory.make_env())


WAYS: dict[str, Callable[[BenchOptions, str, str, int], Vector]] = {
    "two_processes": Apart,
    "two_in_vector_env": VectorEnv,
}
"""How two environments are stepped at the same time."""


def run_processes(options: BenchOptions, write_line: WriteLine) -> list[BenchRow]:
    """Measures HabPick-v1 in two processes against one, in each scene and each way."""
    rows: list[BenchRow] = []
    for (scene,) in options.groups:
        for variant, way in WAYS.items():
            with (
                closing(way(options, PICK, scene, 1)) as one,
                closing(way(options, PICK, scene, 2)) as two,
            ):
                write_line(f"suite processes, scene {scene}, {variant}: three processes are ready")
                pairs = alternate(options, one, two, write_line)
            rows.append(process_row(("processes", scene, PICK, variant), pairs))
    return rows


def alternate(
    options: BenchOptions, one: Vector, two: Vector, write_line: WriteLine
) -> list[tuple[float, float]]:
    """Returns steps/s of one and of two processes, measured in turn after a round to warm up."""
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
    """Returns the row of two processes beside one; its ratio is how much faster they are."""
    ones, twos = [a for a, _ in pairs], [b for _, b in pairs]
    return make_row(name, twos, ones, unit="steps/s", reference=ONE)
