"""Subcommands whose work is imported when they run."""

from __future__ import annotations

from dataclasses import dataclass
from pkgutil import resolve_name
from typing import ClassVar

from hab_tasks.console import Command


@dataclass(frozen=True, kw_only=True)
class WorkCommand(Command):
    """Options of a subcommand whose work is a function of another module, imported when it runs.

    Attributes:
        work: ``module:function`` (options) -> exit status. Its imports take seconds, and neither
            `--help` nor another subcommand needs them.
    """

    work: ClassVar[str]

    def run(self) -> int:
        """Imports and does the work."""
        return resolve_name(self.work)(self)
