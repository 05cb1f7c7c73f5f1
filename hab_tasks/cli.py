"""The console script `hab-tasks`."""

from __future__ import annotations

from collections.abc import Sequence

from hab_tasks.commands import COMMANDS
from hab_tasks.console import run_script

DESCRIPTION = "Environments, datasets and episodes of hab-tasks."


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs `hab-tasks`; returns its exit status."""
    return run_script("hab-tasks", COMMANDS, arguments, DESCRIPTION)
