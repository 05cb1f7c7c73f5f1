"""Frozen dataclasses, such as recipes, as JSON-serialisable values and back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, is_dataclass, replace
from typing import Any, TypeVar, get_args, get_type_hints

from hab_tasks.errors import UnknownNameError

T = TypeVar("T")

REMOVED = {"map_memory": False, "mirrors": False, "stop_weight": 1.0}
"""Entries that earlier versions had, with the values in weights that ship."""


def changed(config: T, **values: Any) -> T:
    """Returns a config with those of the values that are not None."""
    given = {name: value for name, value in values.items() if value is not None}
    return replace(config, **given)  # pyright: ignore[reportArgumentType, reportCallIssue]


def to_json(config: Any) -> dict[str, Any]:
    """Returns a config as JSON-serialisable values."""
    return asdict(config)


def from_json(kind: type[T], values: Mapping[str, Any]) -> T:
    """Returns the config of a class from the values of `to_json`.

    Raises:
        UnknownNameError: An entry that the class does not have.
    """
    hints = get_type_hints(kind)
    arguments: dict[str, Any] = {}
    for name, value in values.items():
        if name in REMOVED and value == REMOVED[name]:
            continue
        if name not in hints:
            raise UnknownNameError(f"entry of {kind.__name__}", name, hints)
        kinds = [kind for kind in (hints[name], *get_args(hints[name])) if is_dataclass(kind)]
        if kinds and value is not None:
            arguments[name] = from_json(kinds[0], value)  # pyright: ignore[reportArgumentType]
        else:
            arguments[name] = tuple(value) if isinstance(value, list) else value
    return kind(**arguments)
