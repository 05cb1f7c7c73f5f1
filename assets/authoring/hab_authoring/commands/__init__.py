"""Subcommands of authors, which `hab-tasks` finds by the entry point of this package."""

from hab_authoring.commands.assets import Assets
from hab_authoring.commands.check import Check
from hab_authoring.commands.convert import Convert
from hab_authoring.commands.docs import Docs
from hab_authoring.commands.figures import Figures
from hab_authoring.commands.vary import Vary
from hab_tasks.console import Command

COMMANDS: dict[str, type[Command]] = {
    "check": Check,
    "vary": Vary,
    "assets": Assets,
    "figures": Figures,
    "convert": Convert,
    "docs": Docs,
}
"""Subcommand -> options, in the order of `--help`."""
