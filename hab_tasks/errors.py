"""Errors a user can act on. Each names the bad value, the valid ones and what to do next."""

from __future__ import annotations

import difflib
import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

LONGEST_PATH = 300
"""Of a longer path, the middle is not shown."""

SHOWN_CHARACTERS = 80
SHOWN_DIGITS = 20


class HabError(Exception):
    """Base of every error that bad input or a missing file can cause."""


class UnknownNameError(HabError):
    """A name that is not in the list of valid names.

    The message holds the bad name, the nearest match and all valid names.
    """

    def __init__(self, kind: str, name: object, valid: Iterable[str]) -> None:
        choices = sorted(valid)
        near = difflib.get_close_matches(str(name), choices, n=1, cutoff=0.5)
        hint = f" Did you mean {near[0]!r}?" if near else ""
        shown = ", ".join(choices[:12]) + (f" and {len(choices) - 12} more" if choices[12:] else "")
        super().__init__(f"Unknown {kind} {name!r}.{hint} Valid: {shown or '(none)'}.")
        self.kind, self.name, self.valid = kind, name, choices


def shown(value: Any) -> str:
    """Returns a bad value as JSON shows it, cut short."""
    if isinstance(value, int) and abs(value) >= 10**SHOWN_DIGITS:
        return f"a number of {math.floor(math.log10(abs(value))) + 1} digits"
    try:
        text = json.dumps(value)
    except (TypeError, ValueError, RecursionError):
        text = repr(value) if isinstance(value, (str, bytes)) else f"a {type(value).__name__}"
    return text if len(text) <= SHOWN_CHARACTERS else f"{text[:SHOWN_CHARACTERS]}..."


def _shown_path(path: str) -> str:
    """Returns a path as one short line can hold it."""
    if len(path) > LONGEST_PATH:
        path = f"{path[: LONGEST_PATH // 2]}...{path[-LONGEST_PATH // 2 :]}"
    return path if path.isprintable() else repr(path)


class FileError(HabError):
    """A file or folder that cannot be written, or may not be replaced."""

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(f"{_shown_path(str(path))} {reason}.")
        self.path, self.reason = path, reason


class DatasetError(HabError):
    """A scene or object dataset that cannot be used. The message starts with the file's path."""


class EpisodeError(HabError):
    """An episode, or a file of episodes, that cannot be used."""


class GenerationError(HabError):
    """No acceptable episode was found within the allowed number of attempts."""


class RenderingUnavailableError(HabError):
    """Images were asked for, and no Vulkan device can draw them."""


class ActionError(HabError, ValueError):
    """An action that is not finite or has the wrong shape."""


class OptionError(HabError, ValueError):
    """A value that an option does not take."""

    def __init__(self, option: str, value: object, valid: str) -> None:
        typed = option.startswith("--")
        said = f"{option} {shown(value)}:" if typed else f"{option} is {value!r};"
        super().__init__(f"{said} it has to be {valid}.")
        self.option, self.value = option, value


class WorkerError(HabError):
    """A worker process that was killed, as the system does when memory is short."""

    def __init__(self) -> None:
        super().__init__(
            "A worker process was killed, perhaps for want of memory; nothing was written. Run the "
            "same command again, with fewer --workers if need be."
        )
