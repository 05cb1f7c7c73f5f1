"""Executor of this machine: one process, or a pool of them."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from concurrent.futures import as_completed
from typing import Any

from hab_tasks.executors.executor import J, R, Task
from hab_tasks.processes import worker_pool


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
            work = task.start(*task.arguments)
            for index, job in enumerate(jobs):
                yield index, work(job)
            return
        count = min(self.workers, len(jobs))
        with worker_pool(count, _start, (task.start, task.arguments)) as pool:
            waiting = {pool.submit(_work, job): index for index, job in enumerate(jobs)}
            for done in as_completed(waiting):
                yield waiting.pop(done), done.result()


_worker_function: Callable[[Any], Any]


def _start(start: Callable[..., Callable[[Any], Any]], arguments: tuple[Any, ...]) -> None:
    global _worker_function
    _worker_function = start(*arguments)


def _work(job: Any) -> Any:
    return _worker_function(job)
