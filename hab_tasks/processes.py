"""Worker processes that end with the process that started them, even when that one is killed."""

from __future__ import annotations

import multiprocessing
import os
import threading
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import torch
from threadpoolctl import threadpool_limits

LOOK_EVERY_S = 1.0


def worker_pool(
    workers: int, start: Callable[..., None] | None = None, arguments: tuple[Any, ...] = ()
) -> ProcessPoolExecutor:
    """Returns a pool of new Python processes, each with one thread for its arithmetic.

    Args:
        workers: How many.
        start: Called once in each, with `arguments`.
        arguments: What `start` is given; sent to the processes.
    """
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(workers, context, _begin, (start, arguments))


def use_one_thread() -> None:
    """Keeps this process's arithmetic on one thread.

    More gain nothing on tensors this small, would wait for one another beside other processes,
    and one makes sums reproducible.
    """
    torch.set_num_threads(1)
    threadpool_limits(limits=1)


def _begin(start: Callable[..., None] | None, arguments: tuple[Any, ...]) -> None:
    use_one_thread()
    threading.Thread(target=_end_with_parent, args=(os.getppid(),), daemon=True).start()
    if start is not None:
        start(*arguments)


def _end_with_parent(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(LOOK_EVERY_S)
    os._exit(1)
