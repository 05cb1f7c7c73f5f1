"""The console script `hab-spa`."""

from __future__ import annotations

from collections.abc import Sequence

from hab_spa.recording.options import RecordCommand
from hab_tasks.io.console import Command, run_script

COMMANDS: dict[str, type[Command]] = {"record": RecordCommand}


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs `hab-spa`; returns its exit status."""
    return run_script("hab-spa", COMMANDS, arguments)
