"""Interface of the executors."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

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
