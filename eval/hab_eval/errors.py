"""What can go wrong in an evaluation, beside what `hab_tasks.errors` names."""

from __future__ import annotations

import json
import math
from typing import Any

from hab_tasks.errors import HabError

SHOWN_CHARACTERS = 80
SHOWN_DIGITS = 20


def shown(value: Any) -> str:
    """Returns a bad value as JSON shows it, cut short."""
    if isinstance(value, int) and abs(value) >= 10**SHOWN_DIGITS:
        return f"a number of {math.floor(math.log10(abs(value))) + 1} digits"
    try:
        text = json.dumps(value)
    except (TypeError, ValueError, RecursionError):
        text = repr(value) if isinstance(value, (str, bytes)) else f"a {type(value).__name__}"
    return text if len(text) <= SHOWN_CHARACTERS else f"{text[:SHOWN_CHARACTERS]}..."


def check_number(name: str, value: Any, *, least: int, most: int) -> None:
    """Refuses what is no whole number from `least` to `most`.

    Raises:
        OptionError: Names the option, the bound and the value.
    """
    if isinstance(value, bool) or not isinstance(value, int):
        raise OptionError(f"{name} must be a whole number, got {shown(value)}.")
    if value < least:
        raise OptionError(f"{name} must be at least {least}, got {shown(value)}.")
    if value > most:
        raise OptionError(f"{name} must be at most {most}, got {shown(value)}.")


class AgentError(HabError):
    """An agent that cannot be loaded or that breaks the `Agent` protocol."""


class OptionError(HabError):
    """An option whose value is out of range."""


class ResultError(HabError):
    """A result file that does not follow the schema. The message starts with the file's path."""


class RunFolderError(HabError):
    """A result folder that may not be written to, or that belongs to another run."""


class BenchError(HabError):
    """A benchmark that cannot be run as asked."""


class RunStoppedError(HabError):
    """A run that ended before its last episode; the finished ones are kept.

    Attributes:
        details: Traceback of the cause, "" if there is none.
    """

    def __init__(self, message: str, *, details: str = "") -> None:
        super().__init__(message)
        self.details = details
