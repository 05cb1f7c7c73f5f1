"""Worker processes that exit with their parent process, even if it is killed."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import resource_tracker
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
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(workers, WORKER_CONTEXT, _begin, (start, arguments))
    try:
        yield pool
    except BaseException as error:
        for process in set(multiprocessing.active_children()) - others:
            process.kill()
        if isinstance(error, BrokenProcessPool):
            raise WorkerError from error
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def use_one_thread() -> None:
    """Limits this process to one compute thread.

    More threads do not speed up tensors this small, and compete with other processes. A single
    thread also makes sums reproducible.
    """
    torch.set_num_threads(1)
    threadpool_limits(limits=1)


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
