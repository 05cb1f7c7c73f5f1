"""One entry of a JSON file at a time: what is read is of its type, finite and readable again."""

from __future__ import annotations

import gzip
import json
import math
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hab_tasks.errors import EpisodeError, UnknownNameError, shown
from hab_tasks.geometry import Pose7

LARGEST_BYTES = 256 * 2**20
"""Of an episode file, unpacked: some hundred thousand episodes."""

LARGEST_INTEGER = 2**63


def load_json(file: Path) -> Any:
    """Returns what a ``.json`` or ``.json.gz`` file holds.

    Raises:
        EpisodeError: Absent, not a regular file, too large, or damaged.
    """
    try:
        if file.exists() and not file.is_file():
            raise EpisodeError(f"{file}: not a regular file.")
        with gzip.open(file) if file.suffix == ".gz" else file.open("rb") as stream:
            data = stream.read(LARGEST_BYTES + 1)
        if len(data) > LARGEST_BYTES:
            raise EpisodeError(f"{file}: more than {LARGEST_BYTES // 2**20} MiB of JSON.")
        return json.loads(data)
    except FileNotFoundError as error:
        raise EpisodeError(f"{file}: no such file.") from error
    except RecursionError as error:
        raise EpisodeError(f"{file}: not a valid episode file (nested too deeply).") from error
    except (OSError, EOFError, ValueError, zlib.error) as error:
        raise EpisodeError(f"{file}: not a valid episode file ({error}).") from error


@contextmanager
def naming(where: str, name: str) -> Iterator[None]:
    """Names the episode and the field when something in it is missing, odd or unknown."""
    try:
        yield
    except KeyError as error:
        raise EpisodeError(f"{where}, field {name}: {error} is missing.") from error
    except UnknownNameError as error:
        raise EpisodeError(f"{where}, field {name}: {error}") from error
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise EpisodeError(f"{where}, field {name}: malformed ({error}).") from error


def mapping(value: Any) -> dict[str, Any]:
    """Returns an object of JSON, with names that are text. Raises TypeError for anything else."""
    if not isinstance(value, dict):
        raise TypeError(f"{shown(value)} instead of an object")
    return {text(key): entry for key, entry in value.items()}


def sequence(value: Any) -> list[Any]:
    """Returns a list. Raises TypeError for anything else, text too."""
    if not isinstance(value, list | tuple):
        raise TypeError(f"{shown(value)} instead of a list")
    return list(value)


def text(value: Any) -> str:
    """Returns text. Raises TypeError or ValueError when it is none, or cannot be written."""
    if not isinstance(value, str):
        raise TypeError(f"{shown(value)} instead of text")
    value.encode()  # refuses half a character
    return value


def integer(value: Any) -> int:
    """Returns an integer of at most 64 bits. Raises TypeError or ValueError for anything else."""
    if not isinstance(value, int) or isinstance(value, bool):
        raise TypeError(f"{shown(value)} instead of an integer")
    if abs(value) >= LARGEST_INTEGER:
        raise ValueError(f"{shown(value)} is too large")
    return value


def number(value: Any) -> float:
    """Returns a number. Raises TypeError or ValueError when it is none, or not finite."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        raise TypeError(f"{shown(value)} instead of a number")
    try:
        found = float(value)
    except OverflowError:
        found = math.inf
    if not math.isfinite(found):
        raise ValueError(f"{shown(value)} is not a finite number")
    return found


def read_pose(value: Any) -> Pose7:
    """Returns a pose as files hold it. Raises TypeError or ValueError for anything else."""
    numbers = tuple(number(x) for x in sequence(value))
    if len(numbers) != 7:
        raise ValueError(f"a pose needs 7 numbers, found {len(numbers)}")
    if not 0 < math.hypot(*numbers[3:]) < math.inf:
        raise ValueError("a pose whose quaternion is zero or too large")
    return numbers  # type: ignore[return-value]
