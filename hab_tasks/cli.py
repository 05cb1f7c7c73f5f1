"""The console script `hab-tasks`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.metadata import entry_points

from hab_tasks.commands.options import Demo, Episodes, List
from hab_tasks.io.console import EXIT_BAD_INPUT, Command, run_script, say

PROGRAM = "hab-tasks"
DESCRIPTION = "Environments, datasets and episodes of hab-tasks."

GROUP = "hab_tasks.commands"
"""Entry points of packages with more subcommands, each naming a table like `COMMANDS`."""

COMMANDS: dict[str, type[Command]] = {"list": List, "demo": Demo, "episodes": Episodes}
"""Subcommand -> options, in the order of `--help`; those of installed packages follow."""

for _entry in entry_points(group=GROUP):
    COMMANDS |= _entry.load()

AUTHORING = ("check", "vary", "assets", "figures", "convert", "docs")
"""Subcommands of hab-authoring."""

INSTALL_AUTHORING = "pip install -e assets/authoring"


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs `hab-tasks`; returns its exit status."""
    arguments = sys.argv[1:] if arguments is None else arguments
    for name in arguments[:1]:
        if name in AUTHORING and name not in COMMANDS:
            say(
                PROGRAM,
                f"{name} is a command of hab-authoring, which is not installed. "
                f"In the repository of hab-tasks: {INSTALL_AUTHORING}",
            )
            return EXIT_BAD_INPUT
    return run_script(PROGRAM, COMMANDS, arguments, DESCRIPTION)
