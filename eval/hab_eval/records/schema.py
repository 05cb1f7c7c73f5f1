"""Strict JSON to frozen dataclasses: unknown keys, missing keys and wrong types are errors.

Numbers must be finite and small enough for sums of squares, and strings must be valid UTF-8. The
metadata of a field can add constraints. Errors name the file, the field and the episode, if any.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import types
import typing
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from hab_eval.errors import ResultError
from hab_tasks.errors import SHOWN_CHARACTERS, HabError, shown

T = TypeVar("T")

MAY_BE_ABSENT = {"may_be_absent": True}
"""Field metadata: the key is optional, because older files lack it; the default is used."""

NOT_NEGATIVE = {"not_negative": True}
"""Field metadata: numbers, also those inside a dict, must be >= 0."""

NOT_EMPTY = {"not_empty": True}
"""Field metadata: text must not be blank."""

LARGEST_NUMBER = 1e100
"""Larger than any measurement, with finite sums and squares."""

LARGEST_INT = 2**63 - 1
"""JSON readers in other languages use 64-bit integers."""

MOST_KEYS = 5
"""Maximum number of unknown keys in an error."""


def json_key(field: dataclasses.Field[Any]) -> str:
    """Returns a field's JSON key, which may be a Python keyword such as `return`."""
    return field.metadata.get("key", field.name)


def parse_json(path: Path) -> Any:
    """Reads a JSON file.

    Raises:
        ResultError: The file cannot be read or is not JSON.
    """
    try:
        if path.exists() and not path.is_file():
            raise ResultError(f"{path}: cannot be read as JSON: not a regular file.")
        return parse_json_text(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ResultError(f"{path}: cannot be read as JSON: {error}") from error


def parse_json_text(text: str) -> Any:
    """Parses JSON. NaN and infinities pass, so that `read_dataclass` can name their field.

    Raises:
        ValueError: The text is not JSON, has a duplicate key, or is nested too deeply.
    """
    try:
        return json.loads(text, object_pairs_hook=_object)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def to_json(value: Any) -> Any:
    """Converts dataclasses to plain JSON values, with their JSON keys."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        pairs = [(json_key(f), getattr(value, f.name)) for f in dataclasses.fields(value)]
        return {key: to_json(item) for key, item in pairs}
    if isinstance(value, dict):
        return {key: to_json(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [to_json(item) for item in value]
    return value


def read_dataclass(cls: type[T], data: Any, where: str) -> T:
    """Builds `cls` from parsed JSON.

    Args:
        cls: A dataclass of str, int, float, bool, None, Any, tuples, dicts and dataclasses.
        data: Parsed JSON.
        where: Location for errors, e.g. ``run.json: episodes[3]``.

    Raises:
        ResultError: Has the location, the expected and the actual value.
    """
    _expect(isinstance(data, dict), where, "an object", data)
    members = _members(cls)
    needed = {key for key, (member, _) in members.items() if "may_be_absent" not in member.metadata}
    unknown, missing = sorted(data.keys() - members.keys()), sorted(needed - data.keys())
    if unknown or missing:
        more = f" and {len(unknown) - MOST_KEYS} more" if len(unknown) > MOST_KEYS else ""
        told = [key[:SHOWN_CHARACTERS] for key in unknown[:MOST_KEYS]]
        raise ResultError(
            f"{where}: missing keys {missing or '(none)'}, unknown keys {told or '(none)'}{more}; "
            f"the schema has {', '.join(members)}."
        )
    values = {
        member.name: _read(hint, data[key], f"{where}: {key}", member.metadata)
        for key, (member, hint) in members.items()
        if key in data
    }
    try:
        return cls(**values)
    except HabError as error:
        raise ResultError(f"{where}: {error}") from error


def is_text(value: str) -> bool:
    """Returns whether a string can be encoded as UTF-8; lone surrogates cannot."""
    try:
        value.encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True


def name_episode(entry: Any) -> str:
    """Returns a sentence with the episode of a file entry, "" if it has no id."""
    name = entry.get("id") if isinstance(entry, dict) else None
    return f" It is episode {shown(name)}." if isinstance(name, str) else ""


@functools.cache
def _members(cls: type) -> dict[str, tuple[dataclasses.Field[Any], Any]]:
    """Returns JSON key -> (field, type)."""
    hints = typing.get_type_hints(cls)
    found = dataclasses.fields(typing.cast(Any, cls))
    return {json_key(field): (field, hints[field.name]) for field in found}


def _read(hint: Any, value: Any, where: str, rules: Mapping[str, Any]) -> Any:
    """Checks `value` against a type and the rules of its field, and converts it."""
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if hint is Any:
        return value
    if origin in (types.UnionType, typing.Union):
        inner = [arg for arg in args if arg is not type(None)]
        return None if value is None else _read(inner[0], value, where, rules)
    if dataclasses.is_dataclass(hint):
        return read_dataclass(typing.cast(type, hint), value, where)
    if origin is dict:
        _expect(isinstance(value, dict), where, "an object", value)
        for key in value:
            _expect(is_text(key), where, "names that are valid UTF-8", key)
        return {key: _read(args[1], item, f"{where}.{key}", rules) for key, item in value.items()}
    if origin is tuple:
        _expect(isinstance(value, list), where, "a list", value)
        return _read_tuple(args, value, where, rules)
    if hint is float or hint is int:
        return _read_number(hint, value, where, rules)
    _expect(type(value) is hint, where, f"a value of type {hint.__name__}", value)
    if hint is str:
        _expect(is_text(value), where, "text that is valid UTF-8", value)
        _expect(bool(value.strip()) or "not_empty" not in rules, where, "a name", value)
    return value


def _read_number(hint: type, value: Any, where: str, rules: Mapping[str, Any]) -> int | float:
    """Reads a number; a float field also accepts an int."""
    if isinstance(value, float) and not math.isfinite(value):
        name = "NaN" if math.isnan(value) else "-Infinity" if value < 0 else "Infinity"
        raise ResultError(f"{where}: {name} is not JSON; a finite number is expected.")
    if hint is int:
        _expect(type(value) is int, where, "a value of type int", value)
    else:
        _expect(type(value) in (int, float), where, "a number", value)
    largest = LARGEST_INT if hint is int else LARGEST_NUMBER
    if not -largest <= value <= largest:
        raise ResultError(f"{where}: {shown(value)} is too large; at most {largest:g} is expected.")
    _expect(value >= 0 or "not_negative" not in rules, where, "a number >= 0", value)
    return hint(value)


def _read_tuple(
    args: tuple[Any, ...], value: list[Any], where: str, rules: Mapping[str, Any]
) -> tuple[Any, ...]:
    """Reads a list as `tuple[T, ...]` or as a tuple of fixed length."""
    if args[-1] is not Ellipsis:
        _expect(len(value) == len(args), where, f"a list of {len(args)}", value)
        pairs = enumerate(zip(args, value, strict=True))
        return tuple(_read(arg, item, f"{where}[{i}]", rules) for i, (arg, item) in pairs)
    return tuple(_read_entry(args[0], item, f"{where}[{i}]", rules) for i, item in enumerate(value))


def _read_entry(hint: Any, value: Any, where: str, rules: Mapping[str, Any]) -> Any:
    """Reads an entry of a list; errors name its episode."""
    try:
        return _read(hint, value, where, rules)
    except ResultError as error:
        raise ResultError(f"{error}{name_episode(value)}") from error


def _expect(ok: bool, where: str, wanted: str, value: Any) -> None:
    if not ok:
        raise ResultError(f"{where}: expected {wanted}, got {shown(value)}.")


def _object(pairs: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    """Builds an object; raises on duplicate keys, of which `json` would keep only the last."""
    given = list(pairs)
    found = dict(given)
    if len(found) < len(given):
        keys = [key for key, _ in given]
        raise ValueError(f"duplicate key {shown(next(k for k in keys if keys.count(k) > 1))}")
    return found
