"""Rejection of a candidate start state."""

from __future__ import annotations

from hab_tasks.errors import HabError


class RejectedSampleError(HabError):
    """A rejected candidate; another one is sampled.

    The message is the counted reason. Episode files store it, so changing it changes the files.
    """
