"""What both sides of a benchmark share: a process of its own and the timed loop.

Ours and the reference each live in a process, so that neither sees the other's memory, patches or
asset folder; the parent lets them run in turn, never at the same time.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any, Protocol

from torch import Tensor

from hab_eval.bench_motion import Motion
from hab_eval.errors import BenchError
from hab_tasks.constants import CONTROL_HZ
from hab_tasks.processes import use_one_thread

START_TIMEOUT_S = 600.0
STOP_TIMEOUT_S = 10.0

QUIET_STEPS = 2 * CONTROL_HZ
"""Steps before the clock starts. Setting a pose wakes an object, and the engine puts it back to
sleep after half a second or more (measured: 3.4 ms a step until then in apt_0, 0.8 ms after)."""


@dataclass(frozen=True, kw_only=True)
class StepTiming:
    """How long a number of steps took, and how long of it the physics engine ran [s]."""

    steps: int
    total_s: float
    engine_s: float

    @property
    def steps_per_s(self) -> float:
        """Control steps a second."""
        return self.steps / self.total_s

    @property
    def engine_ms(self) -> float:
        """Time in the engine, a step [ms]."""
        return 1e3 * self.engine_s / self.steps

    @property
    def outside_ms(self) -> float:
        """Time outside the engine, a step [ms]."""
        return 1e3 * (self.total_s - self.engine_s) / self.steps

    @property
    def physics_share(self) -> float:
        """Time in the engine / time of the step."""
        return self.engine_s / self.total_s


class Side(Protocol):
    """One of the two environments that are compared."""

    def run_steps(self, motion: Motion) -> StepTiming:
        """Times small random motions from a fixed start."""
        ...

    def soft_reset(self) -> float:
        """Times a reset to another start in the same scene [s]."""
        ...

    def other_layout(self) -> float:
        """Times a reset to the next layout [s]; the reference has to build it anew."""
        ...

    def layouts(self) -> int:
        """Returns how many layouts `other_layout` goes round."""
        ...

    def close(self) -> None:
        """Frees the simulator."""
        ...


def time_steps(env: Any, idle: Tensor, actions: Tensor) -> StepTiming:
    """Steps through `actions` (S, A); measures the engine inside these very steps.

    Args:
        env: The environment, just reset.
        idle: (A,) action that moves nothing, for the quiet time before.
        actions: What is timed.
    """
    for _ in range(QUIET_STEPS):
        env.step(idle[None])
    rows = list(actions[:, None])  # S tensors (1, A), made before the clock starts
    with _engine_clock(env.unwrapped.scene) as durations_s:
        started = time.perf_counter()
        for action in rows:
            env.step(action)
        total_s = time.perf_counter() - started
    if not durations_s:
        raise BenchError("The environment does not step its physics through scene.px.")
    return StepTiming(steps=len(rows), total_s=total_s, engine_s=sum(durations_s))


class _TimedEngine:
    """Stands in for a scene's physics system and collects how long each of its steps takes."""

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
def _engine_clock(scene: Any) -> Iterator[list[float]]:
    """Times every physics step of a `ManiSkillScene`; the engine's own class takes no patches."""
    engine = scene.px
    scene.px = timed = _TimedEngine(engine)
    try:
        yield timed.durations_s
    finally:
        scene.px = engine


class RemoteSide:
    """A `Side` in a process of its own."""

    def __init__(self, factory: Callable[[], Side], variables: Mapping[str, str]) -> None:
        """Starts the process.

        Args:
            factory: Picklable; called in the process.
            variables: Environment variables of the process; some are read while importing.
        """
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(factory, theirs), daemon=True)
        with _environment(variables):
            self._process.start()
        theirs.close()
        self._receive()

    def run_steps(self, motion: Motion) -> StepTiming:
        """See `Side`."""
        self.start_steps(motion)
        return self.finish_steps()

    def start_steps(self, motion: Motion) -> None:
        """Begins `run_steps` and returns at once."""
        self._connection.send(("run_steps", (motion,)))

    def finish_steps(self) -> StepTiming:
        """Waits for what `start_steps` began."""
        return self._receive()

    def soft_reset(self) -> float:
        """See `Side`."""
        return self._ask("soft_reset")

    def layouts(self) -> int:
        """See `Side`."""
        return self._ask("layouts")

    def other_layout(self) -> float:
        """See `Side`."""
        return self._ask("other_layout")

    @property
    def pid(self) -> int:
        """The process id."""
        return int(self._process.pid or 0)

    def close(self) -> None:
        """Ends the process."""
        self._connection.close()
        self._process.join(STOP_TIMEOUT_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()

    def _ask(self, method: str) -> Any:
        self._connection.send((method, ()))
        return self._receive()

    def _receive(self) -> Any:
        """Waits for an answer; passes on what went wrong."""
        if not self._connection.poll(START_TIMEOUT_S):
            raise BenchError(f"No answer from a bench process in {START_TIMEOUT_S:.0f} s.")
        try:
            ok, answer = self._connection.recv()
        except EOFError as error:
            self._process.join(STOP_TIMEOUT_S)
            code = self._process.exitcode
            raise BenchError(f"A bench process ended with exit code {code}.") from error
        if not ok:
            raise BenchError(answer)
        return answer


def _serve(factory: Callable[[], Side], connection: Connection) -> None:
    """Runs in the process: answers calls until the parent closes the pipe."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    use_one_thread()
    try:
        side = factory()
        connection.send((True, None))
        while True:
            method, arguments = connection.recv()
            connection.send((True, getattr(side, method)(*arguments)))
    except (EOFError, BrokenPipeError):
        return
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        connection.send(
            (False, f"{type(error).__name__}: {error} ({place.filename}:{place.lineno})")
        )


@contextmanager
def _environment(variables: Mapping[str, str]) -> Iterator[None]:
    """Sets environment variables for the processes that are started inside."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
