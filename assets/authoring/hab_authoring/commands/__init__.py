"""Subcommands of authors, which `hab-tasks` finds by the entry point of this package."""

from hab_authoring.commands.options import Assets, Check, Convert, Docs, Figures, Vary
from hab_tasks.io.console import Command

COMMANDS: dict[str, type[Command]] = {
    "check": Check,
    "vary": Vary,
    "assets": Assets,
    "figures": Figures,
    "convert": Convert,
    "docs": Docs,
}
"""Subcommand -> options, in the order of `--help`."""
