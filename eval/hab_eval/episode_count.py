"""Maximum number of episodes in a file, checked before the file is parsed."""

from __future__ import annotations

import contextlib
import mmap
import os
import re
from pathlib import Path

from hab_eval.config import MOST_EPISODES
from hab_eval.errors import ResultError

SHORTEST_EPISODE_BYTES = 90
"""The keys of an episode with their shortest values, in a record and in a journal."""

EPISODE = re.compile(rb'"failure"\s*:\s*[n"]')
"""What each episode of a file has once: null or a name; timings and scores are numbers."""


def check_size(path: Path) -> None:
    """Checks the number of episodes of a large record or journal without parsing it.

    A file that cannot be read passes; its reader reports it.

    Raises:
        ResultError: There are more than `MOST_EPISODES`.
    """
    with contextlib.suppress(OSError):
        if not os.path.isfile(path):  # unlike Path.is_file, False for an invalid name
            return
        if path.stat().st_size > MOST_EPISODES * SHORTEST_EPISODE_BYTES:
            check_count(_count(path), path)


def check_count(count: int, path: Path) -> None:
    """Checks a number of episodes; `path` is named in the error."""
    if count > MOST_EPISODES:
        raise ResultError(f"{path}: {count} episodes; at most {MOST_EPISODES} are valid.")


def _count(path: Path) -> int:
    """Returns the number of episodes; the system reads the file in pages."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
        return sum(1 for _ in EPISODE.finditer(text))
