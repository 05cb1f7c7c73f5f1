"""Validated reading of dataset files; errors name file, element and value."""

from __future__ import annotations

import json
import math
import reprlib
import stat
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from hab_tasks.errors import DatasetError, UnknownNameError
from hab_tasks.typed_values import number

LARGEST = 1e6
"""Maximum magnitude of any number, due to the engine's single precision."""

LONGEST_REASON = 200
"""Maximum length of a system message about a path."""

_repr = reprlib.Repr()
_repr.maxstring = _repr.maxother = 60
_repr.maxlist = 6


def refused(file: Path, location: str, value: object, wanted: str) -> DatasetError:
    """Returns the error for an invalid value in a file, with its location and the valid values."""
    return DatasetError(f"{file}: {location} is {_repr.repr(value)}; it has to be {wanted}.")


def is_number(value: object) -> bool:
    """Whether a value is a finite number with a magnitude of at most `LARGEST`."""
    try:
        return abs(number(value)) <= LARGEST
    except (TypeError, ValueError):
        return False


def check_number(
    file: Path, location: str, value: Any, *, above: float = -math.inf, least: float = -math.inf
) -> float:
    """Returns a number that is finite, larger than `above` and at least `least`.

    Raises:
        DatasetError: It is not.
    """
    if is_number(value) and value > above and value >= least:
        return float(value)
    bound = f" above {above:g}" if above > -math.inf else ""
    bound = f" of at least {least:g}" if least > -math.inf else bound
    raise refused(file, location, value, f"a number{bound} and at most {LARGEST:g} in size")


def check_numbers(file: Path, location: str, values: Any, count: int) -> tuple[float, ...]:
    """Returns `count` finite numbers.

    Raises:
        DatasetError: The count differs, or one is not a finite number.
    """
    if isinstance(values, list | tuple) and len(values) == count and all(map(is_number, values)):
        return tuple(map(float, values))
    raise refused(file, location, values, f"{count} numbers, each at most {LARGEST:g} in size")


@dataclass(frozen=True)
class Fields:
    """A JSON object in a dataset file, at a location in it that is empty for the whole file."""

    file: Path
    values: Mapping[str, Any]
    location: str = ""

    def __contains__(self, name: str) -> bool:
        """Whether there is a field of this name."""
        return name in self.values

    def text(self, name: str, default: str | None = None) -> str:
        """Returns a string; required and non-empty without `default`."""
        value = self._value(name, default)
        if not isinstance(value, str) or (default is None and not value):
            raise self.refused(name, "a text")
        return value

    def choice(self, name: str, default: str, valid: Iterable[str]) -> str:
        """Returns a string that is one of `valid` in upper case."""
        value = self.text(name, default).upper()
        if value not in valid:
            raise DatasetError(f"{self.file}: {UnknownNameError(self.at(name), value, valid)}")
        return value

    def flag(self, name: str, default: bool = False) -> bool:
        """Returns true or false."""
        value = self._value(name, default)
        if not isinstance(value, bool):
            raise self.refused(name, "true or false")
        return value

    def whole(self, name: str, default: int | None = None) -> int:
        """Returns a whole number."""
        value = self._value(name, default)
        if not is_number(value) or value != int(value):
            raise self.refused(name, "a whole number")
        return int(value)

    def number(
        self,
        name: str,
        default: float | None = None,
        *,
        above: float = -math.inf,
        least: float = -math.inf,
    ) -> float:
        """Returns a finite number, larger than `above` and at least `least`."""
        value = self._value(name, default)
        return check_number(self.file, self.at(name), value, above=above, least=least)

    def vector(
        self, name: str, default: tuple[float, float, float] | None = None
    ) -> tuple[float, float, float]:
        """Returns three finite numbers."""
        x, y, z = check_numbers(self.file, self.at(name), self._value(name, default), 3)
        return x, y, z

    def direction(
        self, name: str, default: tuple[float, float, float]
    ) -> tuple[float, float, float]:
        """Returns three finite numbers that are not all zero."""
        vector = self.vector(name, default)
        if not math.hypot(*vector) > 0:
            raise self.refused(name, "3 numbers that are not all zero")
        return vector

    def rotation(self, name: str) -> tuple[float, ...]:
        """Returns a quaternion (wxyz, not normalised); the identity by default."""
        wxyz = check_numbers(self.file, self.at(name), self._value(name, (1.0, 0.0, 0.0, 0.0)), 4)
        if not math.hypot(*wxyz) > 0:
            raise self.refused(name, "4 numbers that are not all zero")
        return wxyz

    def part(self, name: str, *, optional: bool = False) -> Fields:
        """Returns a nested object; with `optional`, an empty one by default."""
        value = self._value(name, {} if optional else None)
        if not isinstance(value, dict):
            raise self.refused(name, "a JSON object")
        return Fields(self.file, value, self.at(name))

    def parts(self, name: str, *, optional: bool = False) -> list[Fields]:
        """Returns the objects in a list; with `optional`, an empty list by default."""
        values = self._value(name, [] if optional else None)
        if not isinstance(values, list):
            raise self.refused(name, "a list of JSON objects")
        found = [
            Fields(self.file, value, f"{self.at(name)}[{index}]")
            for index, value in enumerate(values)
        ]
        wrong = next((f for f in found if not isinstance(f.values, dict)), None)
        if wrong is not None:
            raise refused(self.file, wrong.location, wrong.values, "a JSON object")
        return found

    def path(self, name: str, default: str | None = None) -> Path:
        """Returns a path relative to this file's folder; the file may be absent."""
        value = self.text(name, default)
        try:
            path = (self.file.parent / value).resolve()
            is_present(path)
            return path
        except (OSError, RuntimeError, ValueError, DatasetError) as error:
            reason = str(getattr(error, "strerror", None) or error)
            reason = reason if len(reason) < LONGEST_REASON else f"...{reason[-LONGEST_REASON:]}"
            raise self.refused(name, f"the name of a file ({reason})") from error

    def refused(self, name: str, wanted: str) -> DatasetError:
        """Returns the error for one of the fields."""
        return refused(self.file, self.at(name), self.values.get(name), wanted)

    def at(self, name: str) -> str:
        """Returns the path of a field in the file."""
        return f"{self.location}.{name}" if self.location else name

    def _value(self, name: str, default: Any) -> Any:
        if name not in self.values and default is None:
            where = f" of {self.location}" if self.location else ""
            raise DatasetError(f"{self.file}: no field {name!r}{where} in it.")
        return self.values.get(name, default)


def read_fields(file: Path) -> Fields:
    """Reads a JSON object field by field.

    Raises:
        DatasetError: Missing, not JSON, or not an object.
    """
    return Fields(file, read_json(file))


def read_json(file: Path) -> dict[str, Any]:
    """Reads a JSON object.

    Raises:
        DatasetError: Missing, not JSON, or not an object; the message names the file and line.
    """
    try:
        value = json.loads(read_bytes(file).decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{file}: not valid JSON ({error}).") from error
    if not isinstance(value, dict):
        raise DatasetError(f"{file}: expected a JSON object, found {type(value).__name__}.")
    return value


def read_urdf(file: Path) -> ElementTree.Element:
    """Reads a URDF without validation of its content.

    Raises:
        DatasetError: It is absent or no XML.
    """
    try:
        return ElementTree.fromstring(read_bytes(file))
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise DatasetError(f"{file}: not a valid URDF ({error}).") from error


def read_bytes(file: Path) -> bytes:
    """Reads a whole file.

    Raises:
        DatasetError: It is absent, not a regular file, or cannot be read.
    """
    check_file(file)
    try:
        return file.read_bytes()
    except OSError as error:
        raise DatasetError(f"{file}: cannot be read ({error.strerror}).") from error


def check_file(file: Path) -> int:
    """Returns the size [bytes] of a regular file; reading anything else might block.

    Raises:
        DatasetError: It is absent, or a folder, a pipe, a circular link or similar.
    """
    try:
        found = file.stat()
    except FileNotFoundError as error:
        raise DatasetError(f"{file}: no such file.") from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise DatasetError(f"{file}: cannot be read ({reason}).") from error
    if not stat.S_ISREG(found.st_mode):
        kind = "a folder" if stat.S_ISDIR(found.st_mode) else "a pipe or a device"
        raise DatasetError(f"{file}: {kind}; it has to be a file.")
    return found.st_size


def is_present(file: Path) -> bool:
    """Whether an optional file exists.

    Raises:
        DatasetError: It exists and is not a regular file.
    """
    try:
        file.stat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    except (OSError, ValueError):
        pass
    check_file(file)
    return True
