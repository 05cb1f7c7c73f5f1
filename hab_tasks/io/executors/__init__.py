"""Executors: run independent jobs in worker processes of this machine or of a Ray cluster."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, Any, Generic, Protocol, TypeVar

import tyro

from hab_tasks.errors import OptionError, UnknownNameError
from hab_tasks.io.pool import WorkerPool

J = TypeVar("J")
R = TypeVar("R")


@dataclass(frozen=True, kw_only=True)
class Task(Generic[J, R]):
    """Function applied to jobs in workers.

    Attributes:
        start: Module-level function; called once in each worker, it returns the function that
            converts a job into its result.
        arguments: Arguments of `start`; pickled.
        name: Returns the name of a job for messages, e.g. "Episode 'a'".
    """

    start: Callable[..., Callable[[J], R]]
    arguments: tuple[Any, ...] = ()
    name: Callable[[J], str]


class Executor(Protocol):
    """Runs jobs, each exactly once; results do not depend on the executor."""

    def in_process(self, jobs: int) -> bool:
        """Returns whether this many jobs run in the calling process, one after another."""
        ...

    def run(self, task: Task[J, R], jobs: Sequence[J]) -> Generator[tuple[int, R], None, None]:
        """Yields (index of the job, result) in order of completion.

        Closing the generator ends the workers.

        Raises:
            RunStoppedError: A job raised, or its worker died repeatedly.
            HabError: A worker could not start because of bad input.
        """
        ...


class LocalExecutor:
    """Runs jobs in `workers` processes; with one worker or one job, in the calling process."""

    def __init__(self, workers: int = 1) -> None:
        self.workers = workers

    def in_process(self, jobs: int) -> bool:
        """Returns whether this many jobs run in the calling process."""
        return self.workers <= 1 or jobs <= 1

    def run(self, task: Task[J, R], jobs: Sequence[J]) -> Generator[tuple[int, R], None, None]:
        """Yields (index of the job, result) in order of completion; see `Executor`."""
        if self.in_process(len(jobs)):
            yield from enumerate(map(task.start(*task.arguments), jobs))
            return
        with WorkerPool(min(self.workers, len(jobs)), task.start, task.arguments) as pool:
            yield from pool.run(jobs)


LOCAL, RAY = "local", "ray"
EXECUTORS = (LOCAL, RAY)


@dataclass(frozen=True, kw_only=True)
class ExecutorChoice:
    """Options that select an executor; part of the options of several commands."""

    executor: Annotated[str, tyro.conf.arg(metavar="NAME")] = LOCAL
    """local: worker processes of this machine; ray: workers of a Ray cluster, which requires the
    package ray. Does not change results."""
    address: Annotated[str | None, tyro.conf.arg(metavar="HOST:PORT")] = None
    """With --executor ray: address of the cluster, or auto for the one on this machine. If not
    given, Ray runs on this machine for the duration of the command."""

    @property
    def is_remote(self) -> bool:
        """Whether workers may be on other machines."""
        return self.executor == RAY

    def check_executor(self) -> None:
        """Checks the options.

        Raises:
            UnknownNameError: Unknown executor.
            OptionError: An address without Ray.
        """
        if self.executor not in EXECUTORS:
            raise UnknownNameError("executor", self.executor, EXECUTORS)
        if self.address is not None and self.executor != RAY:
            raise OptionError(f"--address {self.address} needs --executor ray.")


@contextmanager
def open_executor(
    choice: ExecutorChoice, workers: int = 1, *, device: str = "cpu"
) -> Iterator[Executor]:
    """Yields the chosen executor; a Ray cluster is connected within the context.

    On Ray, each worker whose jobs use the torch device cuda reserves a GPU.

    Raises:
        OptionError: Ray is not installed, or there is no cluster at the address.
    """
    choice.check_executor()
    if choice.executor == LOCAL:
        yield LocalExecutor(workers)
        return
    # Of an optional package's connection, which none but this choice needs.
    from hab_tasks.io.executors import ray_connection, ray_executor

    if device not in ("cpu", "cuda"):
        raise OptionError(f"device {device!r}: Ray assigns the GPUs, so it has to be cpu or cuda.")
    gpus = int(device == "cuda")
    with ray_connection.connected(choice.address, workers):
        yield ray_executor.RayExecutor(workers, gpus=gpus)
