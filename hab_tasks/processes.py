"""Worker processes that exit with their parent process, even if it is killed."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import connection, resource_tracker
from multiprocessing.context import SpawnContext, SpawnProcess
from typing import Any

import torch
from threadpoolctl import threadpool_limits

from hab_tasks.errors import WorkerError


class _Worker(SpawnProcess):
    """A process in which Ctrl-C does nothing: it reaches all, and the parent ends its workers."""

    def start(self) -> None:
        """Starts the process with SIGINT blocked, so that it is also while Python starts."""
        resource_tracker.ensure_running()  # starting it would unblock the signal
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            super().start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _WorkerContext(SpawnContext):
    Process = _Worker


WORKER_CONTEXT = _WorkerContext()
"""Creates worker processes by spawn: the simulator and Vulkan do not survive a fork."""


class _PoolContext(SpawnContext):
    """Creates the worker processes of one pool.

    Attributes:
        workers: Those created.
    """

    def __init__(self) -> None:
        super().__init__()
        self.workers: list[_Worker] = []

    def Process(self, *args: Any, **options: Any) -> _Worker:  # noqa: N802, multiprocessing's name
        """Returns a new worker process."""
        self.workers.append(_Worker(*args, **options))
        return self.workers[-1]


@contextmanager
def worker_pool(
    workers: int, start: Callable[..., None] | None = None, arguments: tuple[Any, ...] = ()
) -> Iterator[ProcessPoolExecutor]:
    """Yields a pool of new Python processes, each limited to one compute thread.

    The processes exit at once when an exception leaves the context, Ctrl-C included, and when this
    process dies.

    Args:
        workers: Number of processes.
        start: Called once in each process, with `arguments`.
        arguments: Arguments of `start`; pickled.

    Raises:
        WorkerError: A worker process was killed.
    """
    context = _PoolContext()
    pool = ProcessPoolExecutor(workers, context, _begin, (start, arguments))
    try:
        yield pool
    except BaseException as error:
        for process in context.workers:
            process.kill()
        if isinstance(error, BrokenProcessPool):
            raise WorkerError from error
        raise
    finally:
        ended = threading.Thread(target=_end_together, args=(context.workers,), daemon=True)
        ended.start()
        pool.shutdown(cancel_futures=True)
        ended.join()


def _end_together(workers: Sequence[SpawnProcess]) -> None:
    """Waits for workers to exit; if one was killed, kills the others.

    A worker that is killed while it waits for work holds a lock that the others wait for as well.
    A pool that is already shutting down would wait for them forever.
    """
    waiting = {worker.sentinel: worker for worker in workers}
    while waiting:
        for sentinel in connection.wait(list(waiting)):
            if _exit_code(waiting.pop(int(sentinel))) != 0:  # pyright: ignore[reportArgumentType]
                for worker in waiting.values():
                    worker.kill()


def _exit_code(process: SpawnProcess) -> int:
    """Returns the exit code of a process that has ended."""
    while (code := process.exitcode) is None:  # another thread is reading it
        time.sleep(0.01)
    return code


def use_one_thread() -> None:
    """Limits this process to one compute thread.

    More threads do not speed up tensors this small, and compete with other processes. A single
    thread also makes sums reproducible.
    """
    torch.set_num_threads(1)
    threadpool_limits(limits=1)


@contextmanager
def compute_threads(count: int) -> Iterator[None]:
    """Lets PyTorch compute in so many threads for a while."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def begin_worker() -> None:
    """Limits this worker process to one compute thread, and ends it when its parent ends."""
    use_one_thread()
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _begin(start: Callable[..., None] | None, arguments: tuple[Any, ...]) -> None:
    begin_worker()
    if start is not None:
        start(*arguments)


def _end_with_parent() -> None:
    """Waits on a pipe that the system closes when the parent exits for any reason."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
