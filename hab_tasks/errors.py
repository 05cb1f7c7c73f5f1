"""Errors for users. Messages name the bad value, the valid ones and the remedy.

The remedy may be a higher limit of the shell (``ulimit``).
"""

from __future__ import annotations

import copyreg
import difflib
import json
import math
import re
import resource
import traceback
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple, Self

LONGEST_PATH = 300
"""Longer paths are abbreviated in the middle."""

SHOWN_CHARACTERS = 80
SHOWN_DIGITS = 20


class HabError(Exception):
    """Base class of errors caused by bad input or missing files.

    Pickles with its message and attributes, independent of the subclass's `__init__`.
    """

    def __reduce__(self) -> tuple[Any, ...]:
        return copyreg.__newobj__, (type(self), *self.args), self.__dict__  # type: ignore[attr-defined]


class UnknownNameError(HabError):
    """Unknown name.

    The message contains the name, the nearest match (`near`, or the most similar name) and the
    valid names.
    """

    def __init__(
        self, kind: str, name: object, valid: Iterable[str], near: str | None = None
    ) -> None:
        choices = sorted(valid)
        found = [near] if near else difflib.get_close_matches(str(name), choices, 1, cutoff=0.5)
        hint = f" Did you mean {found[0]!r}?" if found else ""
        shown = ", ".join(choices[:12]) + (f" and {len(choices) - 12} more" if choices[12:] else "")
        super().__init__(f"Unknown {kind} {name!r}.{hint} Valid: {shown or '(none)'}.")
        self.kind, self.name, self.valid = kind, name, choices


def shown(value: Any) -> str:
    """Formats a bad value as JSON, abbreviated."""
    if isinstance(value, int) and abs(value) >= 10**SHOWN_DIGITS:
        return f"a number of {math.floor(math.log10(abs(value))) + 1} digits"
    try:
        text = json.dumps(value)
    except (TypeError, ValueError, RecursionError):
        text = repr(value) if isinstance(value, (str, bytes)) else f"a {type(value).__name__}"
    return text if len(text) <= SHOWN_CHARACTERS else f"{text[:SHOWN_CHARACTERS]}..."


def _shown_path(path: str) -> str:
    """Formats a path for a one-line message."""
    if len(path) > LONGEST_PATH:
        path = f"{path[: LONGEST_PATH // 2]}...{path[-LONGEST_PATH // 2 :]}"
    return path if path.isprintable() else repr(path)


class FileError(HabError):
    """A file or folder that cannot be written, or may not be replaced."""

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(f"{_shown_path(str(path))} {reason}.")
        self.path, self.reason = path, reason


class DatasetError(HabError):
    """Invalid scene or object dataset. The message starts with the file's path."""


class EpisodeError(HabError):
    """Invalid episode or episode file."""


class GenerationError(HabError):
    """No valid episode was found within the maximum number of attempts."""


class RenderingUnavailableError(HabError):
    """Images were requested, but no Vulkan device can render them."""


class ActionError(HabError, ValueError):
    """An action that is not finite or has the wrong shape."""


class OptionError(HabError, ValueError):
    """Invalid option value, or conflicting options."""

    @classmethod
    def of_value(cls, option: str, value: object, valid: str) -> Self:
        """Returns the error for an invalid option value; `valid` describes the valid ones."""
        if option.startswith("--"):
            return cls(f"{option} {shown(value)}: it has to be {valid}.")
        found = shown(value) if type(value) is int else repr(value)  # an int may be huge
        return cls(f"{option} is {found}; it has to be {valid}.")


class RunStoppedError(HabError):
    """A run that stopped early, not because of bad input; the cause's traceback, or ""."""

    def __init__(self, message: str, *, details: str = "") -> None:
        super().__init__(message)
        self.details = details


class WorkerError(HabError):
    """A worker process ended, usually killed for lack of memory; no pid if it could not start."""

    def __init__(self, pid: int | None, exit_code: int | None) -> None:
        self.pid, self.how = pid, f"ended with exit code {exit_code}"
        if exit_code is not None and exit_code < 0:
            self.how = f"was killed by signal {-exit_code}, possibly for lack of memory"
        super().__init__(
            f"A worker process {self.how}; nothing was written. Run the same command again, with "
            "fewer --workers if necessary."
        )


def reported(what: str, error: BaseException) -> HabError:
    """Returns a HabError itself, and others as a RunStoppedError that `what` has failed.

    It can be pickled, and has the traceback.
    """
    if isinstance(error, HabError):
        return error
    details = "".join(traceback.format_exception(error))
    return RunStoppedError(f"{what}: {type(error).__name__}: {error}", details=details)


class RejectedSampleError(HabError):
    """A rejected candidate; another one is sampled.

    The message is the counted reason. Episode files store it, so changing it changes the files.
    """


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


def limit_advice(error: BaseException) -> str:
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
