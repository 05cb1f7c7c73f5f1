"""Benchmarked environments in separate processes, and the timed loop.

Separate processes isolate memory, patches and asset folder of an environment of `hab_tasks` and the
reference. The parent alternates between them; they never run at the same time.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Protocol

import torch
from torch import Tensor

from hab_eval.errors import BenchError
from hab_tasks.constants import CONTROL_HZ, EE_STEP_M
from hab_tasks.io.pool import Worker

START_TIMEOUT_S = 600.0
STOP_TIMEOUT_S = 10.0

QUIET_STEPS = 2 * CONTROL_HZ
"""Steps before the clock starts. Setting a pose wakes an object, and the engine puts it back to
sleep after half a second or more (measured in apt_0: 3.4 ms per step before, 0.8 ms after)."""


BASE_SPEEDS = (0.2, 0.6)
"""Maximum base speeds: forward [m/s], turning [rad/s]. The base stays within about 0.1 m."""


@dataclass(frozen=True, kw_only=True)
class Motion:
    """A sequence of small random motions.

    Attributes:
        count: Number of steps.
        seed: Seed of the random numbers.
        arm: Whether the end-effector moves.
        base: Whether the base moves.
    """

    count: int
    seed: int
    arm: bool = True
    base: bool = False

    def arm_steps_m(self) -> Tensor:
        """Returns end-effector displacements (count, 3) [m]."""
        moved = EE_STEP_M * self._random()[:, :3]
        return moved if self.arm else torch.zeros_like(moved)

    def base_speeds(self) -> Tensor:
        """Returns forward and turning velocity of the base (count, 2) [m/s, rad/s]."""
        speeds = torch.tensor(BASE_SPEEDS) * self._random()[:, 3:]
        return speeds if self.base else torch.zeros_like(speeds)

    def _random(self) -> Tensor:
        """Returns uniform random numbers in [-1, 1], shape (count, 5)."""
        generator = torch.Generator().manual_seed(self.seed)
        return 2.0 * torch.rand(self.count, 5, generator=generator) - 1.0


@dataclass(frozen=True, kw_only=True)
class StepTiming:
    """Duration of a number of steps, and the physics engine's share of it [s]."""

    steps: int
    total_s: float
    engine_s: float

    @property
    def steps_per_s(self) -> float:
        """Control steps per second."""
        return self.steps / self.total_s

    @property
    def engine_ms(self) -> float:
        """Time in the engine per step [ms]."""
        return 1e3 * self.engine_s / self.steps

    @property
    def outside_ms(self) -> float:
        """Time outside the engine per step [ms]."""
        return 1e3 * (self.total_s - self.engine_s) / self.steps

    @property
    def physics_share(self) -> float:
        """Time in the engine / total time."""
        return self.engine_s / self.total_s


class StepsTimed(Protocol):
    """Something whose steps are timed."""

    def run_steps(self, motion: Motion) -> StepTiming:
        """Times steps."""
        ...

    def close(self) -> None:
        """Frees the simulator."""
        ...


class BenchEnv(StepsTimed, Protocol):
    """A benchmarked environment, whose steps are small random motions from a fixed start."""

    def soft_reset(self) -> float:
        """Times a reset to another start in the same scene [s]."""
        ...

    def other_layout(self) -> float:
        """Times a reset to the next layout [s]; the reference rebuilds its scene for it."""
        ...

    def layouts(self) -> int:
        """Returns the number of layouts through which `other_layout` cycles."""
        ...


def time_steps(env: Any, idle: Tensor, actions: Tensor) -> StepTiming:
    """Times steps with `actions` (S, A), and the physics engine within these steps.

    Args:
        env: The environment, just reset.
        idle: No-op action (A,), for the steps before the clock starts.
        actions: Actions (S, A) of the timed steps.
    """
    for _ in range(QUIET_STEPS):
        env.step(idle[None])
    rows = list(actions[:, None])  # S tensors (1, A), made before the clock starts
    with engine_clock(env.unwrapped.scene) as durations_s:
        started = time.perf_counter()
        for action in rows:
            env.step(action)
        total_s = time.perf_counter() - started
    if not durations_s:
        raise BenchError("The environment does not step its physics through scene.px.")
    return StepTiming(steps=len(rows), total_s=total_s, engine_s=sum(durations_s))


class _TimedEngine:
    """Proxy of a scene's physics system that records the duration of each step."""

    def __init__(self, engine: Any) -> None:
        self._engine = engine
        self.durations_s: list[float] = []

    def step(self) -> None:
        """Steps the engine."""
        started = time.perf_counter()
        self._engine.step()
        self.durations_s.append(time.perf_counter() - started)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._engine, name)


@contextmanager
def engine_clock(scene: Any) -> Iterator[list[float]]:
    """Times every physics step of a `ManiSkillScene`; the engine's class cannot be patched."""
    engine = scene.px
    scene.px = timed = _TimedEngine(engine)
    try:
        yield timed.durations_s
    finally:
        scene.px = engine


class RemoteEnv:
    """A `BenchEnv` in another process."""

    def __init__(self, factory: Callable[[], StepsTimed], variables: Mapping[str, str]) -> None:
        """Starts the process.

        Args:
            factory: Creates the environment in the process; picklable.
            variables: Environment variables of the process, set before its imports.
        """
        self._worker = Worker(_serve, factory, variables=variables)
        self._receive()

    def run_steps(self, motion: Motion) -> StepTiming:
        """See `BenchEnv`."""
        self.start_steps(motion)
        return self.finish_steps()

    def start_steps(self, motion: Motion) -> None:
        """Starts `run_steps` without waiting for it."""
        self._worker.send(("run_steps", (motion,)))

    def finish_steps(self) -> StepTiming:
        """Waits for the result of `start_steps`."""
        return self._receive()

    def soft_reset(self) -> float:
        """See `BenchEnv`."""
        return self._ask("soft_reset")

    def layouts(self) -> int:
        """See `BenchEnv`."""
        return self._ask("layouts")

    def other_layout(self) -> float:
        """See `BenchEnv`."""
        return self._ask("other_layout")

    @property
    def pid(self) -> int:
        """The process id."""
        return self._worker.pid

    def close(self) -> None:
        """Ends the process."""
        self._worker.end(STOP_TIMEOUT_S)

    def _ask(self, method: str) -> Any:
        self._worker.send((method, ()))
        return self._receive()

    def _receive(self) -> Any:
        """Waits for an answer; raises the error of the process."""
        if not self._worker.connection.poll(START_TIMEOUT_S):
            raise BenchError(f"No answer from a bench process within {START_TIMEOUT_S:.0f} s.")
        return self._worker.receive()


def _serve(connection: Connection, factory: Callable[[], StepsTimed]) -> None:
    """Main function of the process: answers calls until the parent closes the pipe."""
    with closing(factory()) as env:
        connection.send(None)
        while True:
            method, arguments = connection.recv()
            connection.send(getattr(env, method)(*arguments))


BYTES_PER_KB, BYTES_PER_MB = 1024, 1e6
"""The kernel reports units of 1024 bytes."""


@dataclass(frozen=True, kw_only=True)
class Memory:
    """Memory of a process [MB].

    Attributes:
        rss_mb: Resident set size; shared pages count fully.
        pss_mb: Proportional set size; pages shared by n processes count 1/n, so sums are valid.
        uss_mb: Unique set size; private pages only, which are freed when the process ends.
    """

    rss_mb: float
    pss_mb: float
    uss_mb: float


def read_memory(pid: int) -> Memory:
    """Reads the memory of a process; Linux only."""
    file = Path(f"/proc/{pid}/smaps_rollup")
    try:
        return parse_rollup(file.read_text(encoding="ascii"))
    except OSError as error:
        raise BenchError(
            f"Memory is read on Linux only; {file} cannot be read: {error}."
        ) from error


def parse_rollup(text: str) -> Memory:
    """Parses `smaps_rollup`: a line with addresses, then lines ``Name: number kB``."""
    fields = (line.split() for line in text.splitlines()[1:])
    kb = {words[0].rstrip(":"): int(words[1]) for words in fields}

    def mb(*names: str) -> float:
        return sum(kb[name] for name in names) * BYTES_PER_KB / BYTES_PER_MB

    return Memory(rss_mb=mb("Rss"), pss_mb=mb("Pss"), uss_mb=mb("Private_Clean", "Private_Dirty"))
