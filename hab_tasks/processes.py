"""Worker processes that end with the process that started them, even when that one is killed."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any

import torch
from threadpoolctl import threadpool_limits

from hab_tasks.errors import WorkerError


@contextmanager
def worker_pool(
    workers: int, start: Callable[..., None] | None = None, arguments: tuple[Any, ...] = ()
) -> Iterator[ProcessPoolExecutor]:
    """Gives a pool of new Python processes, each with one thread for its arithmetic.

    They end at once when something is raised inside, Ctrl-C included, and when this process dies.

    Args:
        workers: How many.
        start: Called once in each, with `arguments`.
        arguments: What `start` is given; sent to the processes.

    Raises:
        WorkerError: A worker process was killed.
    """
    context = multiprocessing.get_context("spawn")
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(workers, context, _begin, (start, arguments))
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
    """Keeps this process's arithmetic on one thread.

    More gain nothing on tensors this small, would wait for one another beside other processes,
    and one makes sums reproducible.
    """
    torch.set_num_threads(1)
    threadpool_limits(limits=1)


def _begin(start: Callable[..., None] | None, arguments: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all; the parent ends its workers
    use_one_thread()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if start is not None:
        start(*arguments)


def _end_with_parent() -> None:
    """Waits on a pipe that the system closes when the parent is gone, however it ended."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
