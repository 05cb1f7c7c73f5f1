"""Limits of the shell (``ulimit``) that are too low, named in errors."""

from __future__ import annotations

import re
import resource
from typing import NamedTuple

from hab_tasks.errors import HabError


class _Limit(NamedTuple):
    """A limit of each process: how the shell names it, and its number in `resource`.

    `unit` is bytes or files in the shell's unit, in which `needed` is the smallest value with which
    everything was run; `signs` are what errors say when it is reached.
    """

    option: str
    kind: int
    unit: int
    needed: int
    signs: re.Pattern[str]

    def too_low(self) -> str:
        """Returns a sentence with the value and the one that is needed; "" if it is enough."""
        value = resource.getrlimit(self.kind)[0]
        if value == resource.RLIM_INFINITY or value >= self.needed * self.unit:
            return ""
        return f"{self.option} is {value // self.unit}; at least {self.needed} is needed."


OPEN_FILES = _Limit("ulimit -n", resource.RLIMIT_NOFILE, 1, 64, re.compile("Too many open files"))
"""A process needs 14, and 3 for each of its workers."""

ADDRESS_SPACE = _Limit(
    "ulimit -v",
    resource.RLIMIT_AS,
    1024,
    4_000_000,
    re.compile(
        "MemoryError|bad_alloc|annot allocate memory|nable to allocate|not enough memory"
        "|failed to map segment|can't start new thread|was killed|ended with signal"
    ),
)
"""[kB] A process with one environment and state observations needs 1,900,000."""


def advice(error: BaseException) -> str:
    """Returns which limit has probably caused an error, as a sentence; "" if none is too low."""
    words, cause = "", error
    while cause is not None:  # the message of an agent's or a worker's error holds its cause
        words += f" {type(cause).__name__}: {cause}"
        cause = cause.__cause__ or cause.__context__
    found = (limit.too_low() for limit in (OPEN_FILES, ADDRESS_SPACE) if limit.signs.search(words))
    return " ".join(sentence for sentence in found if sentence)


def check_open_files() -> None:
    """Checks, before worker processes start, that they can: with too few files their server fails.

    Raises:
        HabError: The limit of open files is too low.
    """
    if sentence := OPEN_FILES.too_low():
        raise HabError(f"Worker processes cannot start: {sentence}")
