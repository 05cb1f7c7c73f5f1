"""Executor of this machine: one process, or a pool of them."""

from __future__ import annotations

from collections.abc import Generator, Sequence

from hab_tasks.io.executors.executor import J, R, Task
from hab_tasks.io.pool import WorkerPool


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
