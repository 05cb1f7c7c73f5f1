"""What every subcommand is: a frozen dataclass of options with a help text and a `run`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar


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
