"""What every subcommand is: a frozen dataclass of options with a help text and a `run`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from hab_tasks.errors import HabError

EPISODE_ENDINGS = (".json", ".json.gz")


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


def check_ending(file: Path) -> None:
    """Raises HabError for an episode file whose name does not say what it holds."""
    if not file.name.endswith(EPISODE_ENDINGS):
        raise HabError(f"--out {file}: an episode file ends in {' or '.join(EPISODE_ENDINGS)}.")
