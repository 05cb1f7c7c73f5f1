"""Executor of a Ray cluster: each worker is an actor, which gets one job at a time.

Only the calling process assigns jobs and takes results. The job of a worker that died, alone or
with its node, goes to another worker; its result has not been taken, so no job counts twice.
A new worker gets its first job after its start, so that no job waits for a free CPU.
"""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections import Counter, deque
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from typing import Any, Generic, NamedTuple

from hab_tasks.errors import HabError, RunStoppedError, reported
from hab_tasks.io.executors import J, R, Task
from hab_tasks.io.executors.ray_connection import imported_ray

MOST_DEATHS = 3
"""A job whose workers died this often stops the run, as do as many starts in a row per worker."""

WAIT_S = 10.0
START_TIMEOUT_S = 300.0
"""Maximum time without any running worker [s]."""


class RayExecutor:
    """Runs jobs in actors of the connected cluster, each with one CPU."""

    def __init__(self, workers: int, *, gpus: int = 0) -> None:
        self.workers, self.gpus = workers, gpus

    def in_process(self, jobs: int) -> bool:
        """Returns False: all jobs run in actors."""
        return False

    def run(self, task: Task[J, R], jobs: Sequence[J]) -> Generator[tuple[int, R], None, None]:
        """Yields (index of the job, result) in order of completion; see `Executor`."""
        ray = imported_ray()
        actor = ray.remote(JobWorker).options(
            num_cpus=1, num_gpus=self.gpus, scheduling_strategy="SPREAD"
        )
        crew = _Crew(ray=ray, actor=actor, task=task, jobs=jobs, workers=self.workers)
        try:
            yield from crew.results()
        except ray.exceptions.RayError as error:
            raise RunStoppedError(f"The Ray cluster failed: {_first_line(error)}") from error
        finally:
            crew.end()


class _Call(NamedTuple):
    """A call of a worker: its start if `index` is None, else a job."""

    worker: Any
    index: int | None


@dataclass(kw_only=True)
class _Crew(Generic[J, R]):
    """The workers of a run, their calls, and the jobs that wait."""

    ray: Any
    actor: Any
    task: Task[J, R]
    jobs: Sequence[J]
    workers: int
    _calls: dict[Any, _Call] = field(default_factory=dict)
    _deaths: Counter[int | None] = field(default_factory=Counter)
    _last_work_s: float = field(default_factory=time.monotonic)

    def __post_init__(self) -> None:
        self._queue = deque(range(len(self.jobs)))
        self._unfinished = len(self.jobs)
        self._start = (this_origin(), self.task.start, self.task.arguments)

    def results(self) -> Generator[tuple[int, R], None, None]:
        """Yields (index, result) until all jobs are finished."""
        exceptions = self.ray.exceptions
        lost = (
            *(exceptions.RayActorError, exceptions.NodeDiedError, exceptions.ObjectLostError),
            *(exceptions.OutOfMemoryError, exceptions.WorkerCrashedError),
        )
        while self._unfinished:
            self._start_missing()
            for reference in self._ended():
                call = self._calls.pop(reference)
                try:
                    answer = self.ray.get(reference)
                except lost as error:
                    self._take_back(call, error)
                    continue
                if isinstance(answer, Failed):
                    raise answer.error
                self._employ(call.worker)  # before the caller takes the result
                if call.index is None:
                    self._deaths.pop(None, None)
                    continue
                self._unfinished -= 1
                yield call.index, answer.value

    def end(self) -> None:
        """Ends all workers."""
        for call in self._calls.values():
            self._kill(call.worker)
        self._calls.clear()

    def _employ(self, worker: Any) -> None:
        """Gives a worker the next job; ends it if there is none, so that others get its CPU."""
        if not self._queue:
            self._kill(worker)
            return
        index = self._queue.popleft()
        job = self.jobs[index]
        reference = worker.work.remote(self.task.name(job), job)
        self._calls[reference] = _Call(worker, index)

    def _start_missing(self) -> None:
        """Starts workers until there is one for each unfinished job, or `workers`."""
        while len(self._calls) < min(self.workers, self._unfinished):
            worker = self.actor.remote()
            self._calls[worker.start.remote(*self._start)] = _Call(worker, None)

    def _ended(self) -> list[Any]:
        """Waits for calls to end; returns some of them.

        Raises:
            RunStoppedError: No worker could start within the time limit.
        """
        ended, _ = self.ray.wait(list(self._calls), timeout=WAIT_S)
        now_s = time.monotonic()
        if ended or any(call.index is not None for call in self._calls.values()):
            self._last_work_s = now_s
        elif now_s - self._last_work_s > START_TIMEOUT_S:
            raise RunStoppedError(
                f"No worker started within {START_TIMEOUT_S:.0f} s: the Ray cluster has no free "
                "CPU or GPU; see `ray status`."
            )
        return ended

    def _take_back(self, call: _Call, error: Exception) -> None:
        """Puts the job of a dead worker first in the queue.

        Raises:
            RunStoppedError: The job has ended too many workers.
        """
        self._kill(call.worker)  # it may still run, cut off from this process
        self._deaths[call.index] += 1
        deaths, most, what = self._deaths[call.index], MOST_DEATHS, "The start of a worker"
        if call.index is None:
            most *= self.workers  # a node that dies takes several
        else:
            what = self.task.name(self.jobs[call.index])
        if deaths >= most:
            raise RunStoppedError(
                f"{what} stopped the run: its worker process died {deaths} times "
                f"({_first_line(error)})"
            )
        if call.index is not None:
            self._queue.appendleft(call.index)

    def _kill(self, worker: Any) -> None:
        with contextlib.suppress(self.ray.exceptions.RayError):  # the cluster may be gone
            self.ray.kill(worker)


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]


PACKAGES = ("hab-tasks", "mani-skill", "mani-skill-nightly", "sapien", "torch", "numpy")
"""Packages whose versions affect results."""


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Process that started the workers: package -> version, working directory, module path."""

    versions: Mapping[str, str]
    folder: str
    path: Sequence[str]


@dataclass(frozen=True, kw_only=True)
class Done:
    """Result of a job; `value` is None after the start."""

    value: Any = None


@dataclass(frozen=True, kw_only=True)
class Failed:
    """Error of a job, or of the start of a worker."""

    error: HabError


def this_origin() -> Origin:
    """Returns the origin of workers that this process starts."""
    return Origin(versions=_versions(), folder=os.getcwd(), path=tuple(sys.path))


class JobWorker:
    """Does jobs; errors are returned, because Ray would wrap them."""

    def start(
        self, origin: Origin, start: Callable[..., Callable[[Any], Any]], arguments: tuple[Any, ...]
    ) -> Done | Failed:
        """Prepares this process and calls the task's `start`."""
        try:
            _adopt(origin)
            # Loads torch, which only a worker with the versions and path of its origin should.
            from hab_tasks.io.threads import use_one_thread

            use_one_thread()
            self._work = start(*arguments)
        except Exception as error:
            return Failed(error=reported("A worker could not start", error))
        return Done()

    def work(self, name: str, job: Any) -> Done | Failed:
        """Does a job; `name` is for messages."""
        try:
            return Done(value=self._work(job))
        except Exception as error:
            return Failed(error=reported(f"{name} stopped the run", error))


def _adopt(origin: Origin) -> None:
    """Takes over the working directory and the search path; checks the versions."""
    sys.path.extend(folder for folder in origin.path if folder not in sys.path)
    if os.path.isdir(origin.folder):
        os.chdir(origin.folder)
    here = _versions()
    different = [
        f"{name} {here[name]} instead of {wanted}"
        for name, wanted in origin.versions.items()
        if here[name] != wanted
    ]
    if different:
        raise HabError(
            f"Node {os.uname().nodename} has {', '.join(different)}; install the same versions on "
            "all nodes."
        )


def _versions() -> dict[str, str]:
    return {name: _version(name) for name in PACKAGES}


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "missing"
