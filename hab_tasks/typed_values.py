"""Strict JSON to frozen dataclasses: unknown keys, missing keys and wrong types are errors.

Numbers must be finite and small enough for sums of squares, and strings must be valid UTF-8. A
field with a default may be absent, as older files lack it. ``Annotated[type, check]`` adds a check
that returns what is expected, "" if the value is. Errors name file, field and value.

No library does this: msgspec ignores unknown keys of dataclasses, keeps the last of two equal keys,
and names neither the value nor the key of a dict at which it stopped.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import types
import typing
from collections.abc import Callable, Iterable
from functools import partial
from itertools import cycle
from typing import Annotated, Any, TypeVar

from hab_tasks.errors import SHOWN_CHARACTERS, HabError, shown

T = TypeVar("T")

LARGEST_NUMBER = 1e100
"""Larger than any measurement, with finite sums and squares."""

LARGEST_INT = 2**63 - 1
"""JSON readers in other languages use 64-bit integers."""

MOST_KEYS = 5
"""Maximum number of unknown keys in an error."""


def _not_negative(value: float) -> str:
    return "" if value >= 0 else "a number >= 0"


def _not_blank(value: str) -> str:
    return "" if value.strip() else "a name"


Name = Annotated[str, _not_blank]
Count = Annotated[int, _not_negative]
Seconds = Annotated[float, _not_negative]


Reader = Callable[[Any], Any]


class _InvalidError(Exception):
    """A value that does not fit.

    Attributes:
        message: What is expected and what is there.
        path: Where the value is.
    """

    def __init__(self, message: str) -> None:
        super().__init__(message)
        self.message, self.path = message, ""

    def at(self, part: str) -> _InvalidError:
        """Adds the part of the path that is before the others."""
        self.path = part + self.path
        return self


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


def is_text(value: str) -> bool:
    """Returns whether a string can be encoded as UTF-8; lone surrogates cannot."""
    try:
        value.encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True


def parse_json(text: str | bytes) -> Any:
    """Parses JSON. NaN and infinities pass, so that `read_value` can name their field.

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
        pairs = [(_json_key(f), getattr(value, f.name)) for f in dataclasses.fields(value)]
        return {key: to_json(item) for key, item in pairs}
    if isinstance(value, dict):
        return {key: to_json(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [to_json(item) for item in value]
    return value


def read_value(kind: type[T], data: Any, where: str, error: type[HabError]) -> T:
    """Builds a value of a type from parsed JSON.

    Args:
        kind: A dataclass, or another type of str, int, float, bool, None, Any, tuples, dicts and
            dataclasses.
        data: Parsed JSON.
        where: Location for errors, e.g. ``run.json: episodes[3]``.
        error: Class of the error that is raised; it has the location, the expected and the actual
            value.
    """
    try:
        return _reader(kind)(data)
    except _InvalidError as invalid:
        raise error(f"{where}{invalid.path}: {invalid.message}") from invalid


def name_episode(entry: Any) -> str:
    """Returns a sentence with the episode of a file entry, "" if it has no id."""
    name = entry.get("id") if isinstance(entry, dict) else None
    return f" It is episode {shown(name)}." if isinstance(name, str) else ""


def _json_key(field: dataclasses.Field[Any]) -> str:
    """Returns a field's JSON key, which may be a Python keyword such as `return`."""
    return field.metadata.get("key", field.name)


@functools.cache
def _reader(hint: Any) -> Reader:
    """Returns what checks a value against a type, and converts it."""
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if hint is Any:
        return lambda value: value
    if origin is Annotated:
        return partial(_read_checked, _reader(args[0]), args[1])
    if origin in (types.UnionType, typing.Union):
        inner = _reader(next(arg for arg in args if arg is not type(None)))
        return lambda value: None if value is None else inner(value)
    if dataclasses.is_dataclass(hint):
        return partial(_read_dataclass, typing.cast(type, hint))
    if origin is dict:
        return partial(_read_dict, _reader(args[1]))
    if origin is tuple:
        count = None if args[-1] is Ellipsis else len(args)
        readers = [_reader(arg) for arg in args if arg is not Ellipsis]
        return partial(_read_list, readers, count)
    if hint is float or hint is int:
        return partial(_read_number, hint, LARGEST_INT if hint is int else LARGEST_NUMBER)
    return partial(_read_plain, hint)


def _read_checked(read: Reader, check: Callable[[Any], str], value: Any) -> Any:
    found = read(value)
    _expect(not (wanted := check(found)), wanted, value)
    return found


def _read_plain(kind: type, value: Any) -> Any:
    """Reads a string or a boolean."""
    if type(value) is not kind or (kind is str and not is_text(value)):
        known = f"a value of type {kind.__name__}"
        raise _unexpected("text that is valid UTF-8" if type(value) is kind else known, value)
    return value


def _read_number(kind: type, largest: float, value: Any) -> int | float:
    """Reads a number; a float field also accepts an int."""
    if type(value) in (kind, int) and -largest <= value <= largest:
        return kind(value)
    if isinstance(value, float) and not math.isfinite(value):
        name = "NaN" if math.isnan(value) else "-Infinity" if value < 0 else "Infinity"
        raise _InvalidError(f"{name} is not JSON; a finite number is expected.")
    wanted = "a value of type int" if kind is int else "a number"
    _expect(type(value) in (kind, int), wanted, value)
    raise _InvalidError(f"{shown(value)} is too large; at most {largest:g} is expected.")


def _read_dict(read: Reader, value: Any) -> dict[str, Any]:
    _expect(isinstance(value, dict), "an object", value)
    found = {}
    for key, item in value.items():
        _expect(is_text(key), "names that are valid UTF-8", key)
        try:
            found[key] = read(item)
        except _InvalidError as error:
            raise error.at(f".{key}") from None
    return found


def _read_list(readers: list[Reader], count: int | None, value: Any) -> tuple[Any, ...]:
    """Reads a list; errors name the episode of an entry, if it is one."""
    _expect(isinstance(value, (list, tuple)), "a list", value)
    _expect(count in (None, len(value)), f"a list of {count}", value)
    found = []
    try:
        for read, item in zip(cycle(readers), value, strict=False):
            found.append(read(item))
    except _InvalidError as error:
        error.message += name_episode(value[len(found)])
        raise error.at(f"[{len(found)}]") from None
    return tuple(found)


def _read_dataclass(cls: type, data: Any) -> Any:
    _expect(isinstance(data, dict), "an object", data)
    members, needed = _members(cls)
    unknown, missing = sorted(data.keys() - members.keys()), sorted(needed - data.keys())
    if unknown or missing:
        more = f" and {len(unknown) - MOST_KEYS} more" if len(unknown) > MOST_KEYS else ""
        told = [key[:SHOWN_CHARACTERS] for key in unknown[:MOST_KEYS]]
        raise _InvalidError(
            f"missing keys {missing or '(none)'}, unknown keys {told or '(none)'}{more}; the "
            f"schema has {', '.join(members)}."
        )
    values = {}
    for key, item in data.items():
        name, read = members[key]
        try:
            values[name] = read(item)
        except _InvalidError as error:
            raise error.at(f": {key}") from None
    try:
        return cls(**values)
    except HabError as error:
        raise _InvalidError(str(error)) from error


@functools.cache
def _members(cls: type) -> tuple[dict[str, tuple[str, Reader]], set[str]]:
    """Returns JSON key -> (field, its reader), and the keys that have to be there."""
    hints = typing.get_type_hints(cls, include_extras=True)
    found = dataclasses.fields(typing.cast(Any, cls))
    absent = dataclasses.MISSING
    needed = {
        _json_key(field) for field in found if field.default is field.default_factory is absent
    }
    return {_json_key(f): (f.name, _reader(hints[f.name])) for f in found}, needed


def _unexpected(wanted: str, value: Any) -> _InvalidError:
    return _InvalidError(f"expected {wanted}, got {shown(value)}.")


def _expect(ok: bool, wanted: str, value: Any) -> None:
    if not ok:
        raise _unexpected(wanted, value)


def _object(pairs: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    """Builds an object; raises on duplicate keys, of which `json` would keep only the last."""
    given = list(pairs)
    found = dict(given)
    if len(found) < len(given):
        keys = [key for key, _ in given]
        raise ValueError(f"duplicate key {shown(next(k for k in keys if keys.count(k) > 1))}")
    return found
