"""JSON files of results; what is wrong with one is a `ResultError`."""

from __future__ import annotations

from pathlib import Path
from typing import Any, TypeVar

from hab_eval.errors import ResultError
from hab_tasks import typed_values

T = TypeVar("T")


def parse_json(path: Path) -> Any:
    """Reads a JSON file.

    Raises:
        ResultError: The file cannot be read or is not JSON.
    """
    try:
        if path.exists() and not path.is_file():
            raise ResultError(f"{path}: cannot be read as JSON: not a regular file.")
        return typed_values.parse_json(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ResultError(f"{path}: cannot be read as JSON: {error}") from error


def read_dataclass(cls: type[T], data: Any, where: str) -> T:
    """Builds `cls` from parsed JSON; see `hab_tasks.typed_values.read_value`.

    Raises:
        ResultError: Has the location, the expected and the actual value.
    """
    return typed_values.read_value(cls, data, where, ResultError)
