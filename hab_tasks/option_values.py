"""Validators of option values, one per type."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from operator import index
from os import PathLike
from typing import Any, TypeVar, cast

import numpy as np

from hab_tasks import typed_values
from hab_tasks.errors import OptionError, UnknownNameError

T = TypeVar("T")

LARGEST_SEED = 2**63 - 1
"""Largest seed accepted by all random number generators."""

LARGEST_RESET_SEED = 2**32 - 1
"""Largest seed accepted by ManiSkill's generators."""

MOST_WORKERS = 1024


def whole(option: str, value: Any, low: int, high: int, unit: str = "") -> int:
    """Returns an integer (of `unit`) from `low` to `high`; raises OptionError for other values."""
    try:
        number = index(value)
    except TypeError:
        number = None
    if isinstance(value, bool) or number is None or not low <= number <= high:
        most = {LARGEST_SEED: "2^63 - 1", LARGEST_RESET_SEED: "2^32 - 1"}.get(high, f"{high:,}")
        kind = f"a whole number of {unit}" if unit else "a whole number"
        raise OptionError.of_value(option, value, f"{kind} from {low} to {most}")
    return number


def number(option: str, value: Any, valid: str) -> float:
    """Returns a finite number; raises OptionError for anything else, saying what is `valid`."""
    try:
        return typed_values.number(value)
    except (TypeError, ValueError) as error:
        raise OptionError.of_value(option, value, valid) from error


def flag(option: str, value: Any) -> bool:
    """Returns True or False; raises OptionError for anything else."""
    if not isinstance(value, bool):
        raise OptionError.of_value(option, value, "True or False")
    return value


def name(option: str, value: Any) -> str | None:
    """Returns text or None; raises OptionError for anything else."""
    if value is not None and not isinstance(value, str):
        raise OptionError.of_value(option, value, "text, or None")
    return value


def names(option: str, value: Any, valid: Sequence[str]) -> tuple[str, ...]:
    """Returns one text or several as a tuple; raises OptionError for anything else."""
    found = (value,) if isinstance(value, str) or not isinstance(value, Iterable) else tuple(value)
    if not all(isinstance(entry, str) for entry in found):
        raise OptionError.of_value(option, value, f"some of {list(valid)}")
    return found


def path(option: str, value: Any) -> Any:
    """Returns a path, as text or as an object, or None; raises OptionError for anything else."""
    if value is not None and not isinstance(value, str | PathLike):
        raise OptionError.of_value(option, value, "a path or a name, or None")
    if "\0" in str(value):
        raise OptionError.of_value(option, value, "a path without a NUL in it")
    return value


def entries(option: str, value: Any) -> dict[str, Any]:
    """Returns a copy of a dict, an empty one for None; raises OptionError for anything else."""
    if value is not None and not isinstance(value, Mapping):
        raise OptionError.of_value(option, value, "a dict, or None")
    return dict(value or {})


def settings(option: str, value: Any, kind: type[T]) -> T | None:
    """Returns a dataclass, from one or from a mapping of its attributes as in JSON; None for None.

    Raises:
        UnknownNameError: The mapping has an unknown attribute.
        OptionError: Any other type.
    """
    if value is None or isinstance(value, kind):
        return value
    known = [field.name for field in fields(cast(Any, kind))]
    if not isinstance(value, Mapping):
        raise OptionError.of_value(option, value, f"None, {kind.__name__} or a dict of {known}")
    for name in value:
        if name not in known:
            raise UnknownNameError(f"entry of {option}", name, known)
    return kind(**value)


def seeds(option: str, value: Any, count: int) -> None:
    """Raises OptionError unless the value is None, a seed, or `count` seeds."""
    several = isinstance(value, Sequence | np.ndarray) and not isinstance(value, str)
    found = list(value) if several else [] if value is None else [value]
    if several and len(found) not in (1, count):
        raise OptionError.of_value(
            option, value, f"one whole number, or one for each of {count} rows"
        )
    for seed in found:
        whole(option, seed, 0, LARGEST_RESET_SEED)


def row_numbers(option: str, value: Any, count: int) -> list[int]:
    """Returns indices of rows below `count`; raises OptionError for anything else."""
    try:
        return [whole(option, row, 0, count - 1) for row in value]
    except TypeError as error:
        raise OptionError.of_value(option, value, f"a list of some of the {count} rows") from error
