"""Strict reading of JSON into frozen dataclasses: no key too many, none missing, no wrong type."""

from __future__ import annotations

import dataclasses
import json
import types
import typing
from pathlib import Path
from typing import Any, TypeVar

from hab_eval.errors import ResultError

T = TypeVar("T")

MAY_BE_ABSENT = {"may_be_absent": True}
"""Metadata of a field that older files lack; its default is read then."""


def json_key(field: dataclasses.Field[Any]) -> str:
    """Returns a field's name in JSON: Python keywords such as `return` need another name here."""
    return field.metadata.get("key", field.name)


def parse_json(path: Path) -> Any:
    """Reads a JSON file; refuses NaN and infinities, which are not JSON."""
    try:
        return parse_json_text(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ResultError(f"{path}: cannot be read as JSON: {error}") from error


def parse_json_text(text: str) -> Any:
    """Parses strict JSON; raises ValueError."""
    return json.loads(text, parse_constant=_refuse_constant)


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
    """
    _expect(isinstance(data, dict), where, "an object", data)
    hints = typing.get_type_hints(cls)
    members = dataclasses.fields(typing.cast(Any, cls))
    keys = {json_key(field): field.name for field in members}
    needed = {json_key(field) for field in members if not field.metadata.get("may_be_absent")}
    unknown, missing = sorted(data.keys() - keys.keys()), sorted(needed - data.keys())
    if unknown or missing:
        raise ResultError(
            f"{where}: missing keys {missing or '(none)'}, unknown keys {unknown or '(none)'}; "
            f"the schema has {', '.join(keys)}."
        )
    given = [(key, name) for key, name in keys.items() if key in data]
    return cls(**{name: _read(hints[name], data[key], f"{where}: {key}") for key, name in given})


def _read(hint: Any, value: Any, where: str) -> Any:
    """Checks `value` against a type and converts it."""
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if hint is Any:
        return value
    if origin in (types.UnionType, typing.Union):
        inner = [arg for arg in args if arg is not type(None)]
        return None if value is None else _read(inner[0], value, where)
    if dataclasses.is_dataclass(hint):
        return read_dataclass(typing.cast(type, hint), value, where)
    if origin is dict:
        _expect(isinstance(value, dict), where, "an object", value)
        return {key: _read(args[1], item, f"{where}.{key}") for key, item in value.items()}
    if origin is tuple:
        _expect(isinstance(value, list), where, "a list", value)
        return _read_tuple(args, value, where)
    if hint is float:
        _expect(_is_number(value), where, "a number", value)
        return float(value)
    _expect(type(value) is hint, where, f"a value of type {hint.__name__}", value)
    return value


def _read_tuple(args: tuple[Any, ...], value: list[Any], where: str) -> tuple[Any, ...]:
    """Reads a list as `tuple[T, ...]` or as a tuple of fixed length."""
    if args[-1] is Ellipsis:
        return tuple(_read(args[0], item, f"{where}[{i}]") for i, item in enumerate(value))
    _expect(len(value) == len(args), where, f"a list of {len(args)}", value)
    pairs = zip(args, value, strict=True)
    return tuple(_read(arg, item, f"{where}[{i}]") for i, (arg, item) in enumerate(pairs))


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _expect(ok: bool, where: str, wanted: str, value: Any) -> None:
    if not ok:
        raise ResultError(f"{where}: expected {wanted}, got {json.dumps(value)[:80]}.")


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name} is not JSON")
