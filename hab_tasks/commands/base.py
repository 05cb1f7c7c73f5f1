"""What every subcommand is: a frozen dataclass of options with a help text and a `run`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from hab_tasks.errors import HabError


@dataclass(frozen=True, kw_only=True)
class Command(ABC):
    """Options of one subcommand.

    Its module imports no simulator, so that `--help` is there at once: `run` imports what it needs.

    Attributes:
        help: What `--help` says, with a worked example.
    """

    help: ClassVar[str]

    @abstractmethod
    def run(self) -> int:
        """Does the work; returns the exit status. Raises HabError for bad input."""


def refuse_existing(out: Path, force: bool) -> None:
    """Raises HabError when `out` exists (a folder: holds anything) and may not be replaced."""
    taken = any(out.iterdir()) if out.is_dir() else out.exists()
    if taken and not force:
        raise HabError(f"{out} exists; give --force to replace it.")
