"""Number of threads in which this process computes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch
from threadpoolctl import threadpool_limits


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
