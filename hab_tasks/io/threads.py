"""Number of threads in which this process computes."""

from __future__ import annotations

import torch
from threadpoolctl import threadpool_limits


def use_one_thread() -> None:
    """Limits this process to one compute thread.

    More threads do not speed up tensors this small, and compete with other processes. A single
    thread also makes sums reproducible.
    """
    torch.set_num_threads(1)
    threadpool_limits(limits=1)
