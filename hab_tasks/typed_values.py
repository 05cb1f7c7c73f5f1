"""Type checks of single values of JSON files and options: right type, finite, serialisable.

They raise TypeError and ValueError; the caller adds the location of the value.
"""

from __future__ import annotations

import math
from typing import Any

from hab_tasks.errors import shown

LARGEST_INTEGER = 2**63


def mapping(value: Any) -> dict[str, Any]:
    """Returns a JSON object with string keys. Raises TypeError for anything else."""
    if not isinstance(value, dict):
        raise TypeError(f"{shown(value)} instead of an object")
    return {text(key): entry for key, entry in value.items()}


def sequence(value: Any) -> list[Any]:
    """Returns a list. Raises TypeError for anything else, including strings."""
    if not isinstance(value, list | tuple):
        raise TypeError(f"{shown(value)} instead of a list")
    return list(value)


def text(value: Any) -> str:
    """Returns a string. Raises TypeError for other types, ValueError if it is not encodable."""
    if not isinstance(value, str):
        raise TypeError(f"{shown(value)} instead of text")
    value.encode()  # raises on lone surrogates
    return value


def integer(value: Any) -> int:
    """Returns an integer of at most 64 bits. Raises TypeError or ValueError for anything else."""
    if not isinstance(value, int) or isinstance(value, bool):
        raise TypeError(f"{shown(value)} instead of an integer")
    if abs(value) >= LARGEST_INTEGER:
        raise ValueError(f"{shown(value)} is too large")
    return value


def number(value: Any) -> float:
    """Returns a number. Raises TypeError for other types, ValueError if it is not finite."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        raise TypeError(f"{shown(value)} instead of a number")
    try:
        found = float(value)
    except OverflowError:
        found = math.inf
    if not math.isfinite(found):
        raise ValueError(f"{shown(value)} is not a finite number")
    return found
