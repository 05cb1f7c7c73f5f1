"""Strict reading of JSON into frozen dataclasses: no key too many, none missing, no wrong type.

Numbers are finite and of a size that can be summed and squared, and strings are text that can be
written. Fields may ask for more in their metadata. Every error names the file and the field, and
the episode if there is one.
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
"""Metadata of a field that older files lack; its default is read then."""

NOT_NEGATIVE = {"not_negative": True}
"""Metadata of a field whose numbers, also those inside of a dict, are from 0."""

NOT_EMPTY = {"not_empty": True}
"""Metadata of a field whose text is not blank."""

LARGEST_NUMBER = 1e100
"""Nothing measured is as large, and sums and squares of smaller numbers are finite."""

LARGEST_INT = 2**63 - 1
"""Readers of JSON in other languages have integers of 64 bits."""

MOST_KEYS = 5
"""Unknown keys that an error names."""


def json_key(field: dataclasses.Field[Any]) -> str:
    """Returns a field's name in JSON: Python keywords such as `return` need another name here."""
    return field.metadata.get("key", field.name)


def parse_json(path: Path) -> Any:
    """Reads a JSON file.

    Raises:
        ResultError: The file cannot be read or is not JSON.
    """
    try:
        if path.exists() and not path.is_file():
            raise ResultError(f"{path}: cannot be read as JSON: it is not a regular file.")
        return parse_json_text(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ResultError(f"{path}: cannot be read as JSON: {error}") from error


def parse_json_text(text: str) -> Any:
    """Parses JSON. NaN and infinities pass, so that `read_dataclass` can say where they are.

    Raises:
        ValueError: The text is not JSON, has a key twice in one object, or is nested too deeply.
    """
    try:
        return json.loads(text, object_pairs_hook=_object)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def to_json(value: Any) -> Any:
    """Turns dataclasses into plain JSON values, under their JSON names."""
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
        where: Place named in errors, e.g. ``run.json: episodes[3]``.

    Raises:
        ResultError: Names the place, what was expected and what was found.
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
    """Returns whether UTF-8 can hold a string; half of a surrogate pair it cannot."""
    try:
        value.encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True


def name_episode(entry: Any) -> str:
    """Returns in words which episode an entry of a file is about, "" if it does not say so."""
    name = entry.get("id") if isinstance(entry, dict) else None
    return f" It is episode {shown(name)}." if isinstance(name, str) else ""


@functools.cache
def _members(cls: type) -> dict[str, tuple[dataclasses.Field[Any], Any]]:
    """Returns JSON key -> field and its type."""
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
            _expect(is_text(key), where, "names that UTF-8 can hold", key)
        return {key: _read(args[1], item, f"{where}.{key}", rules) for key, item in value.items()}
    if origin is tuple:
        _expect(isinstance(value, list), where, "a list", value)
        return _read_tuple(args, value, where, rules)
    if hint is float or hint is int:
        return _read_number(hint, value, where, rules)
    _expect(type(value) is hint, where, f"a value of type {hint.__name__}", value)
    if hint is str:
        _expect(is_text(value), where, "text that UTF-8 can hold", value)
        _expect(bool(value.strip()) or "not_empty" not in rules, where, "a name", value)
    return value


def _read_number(hint: type, value: Any, where: str, rules: Mapping[str, Any]) -> int | float:
    """Reads a number; a whole one will do where any is expected."""
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
    _expect(value >= 0 or "not_negative" not in rules, where, "a number from 0", value)
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
    """Reads an entry of a list; an error names its episode."""
    try:
        return _read(hint, value, where, rules)
    except ResultError as error:
        raise ResultError(f"{error}{name_episode(value)}") from error


def _expect(ok: bool, where: str, wanted: str, value: Any) -> None:
    if not ok:
        raise ResultError(f"{where}: expected {wanted}, got {shown(value)}.")


def _object(pairs: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    """Returns an object; refuses a key that is there twice, of which one would win in silence."""
    given = list(pairs)
    found = dict(given)
    if len(found) < len(given):
        keys = [key for key, _ in given]
        raise ValueError(f"key {shown(next(k for k in keys if keys.count(k) > 1))} is there twice")
    return found
