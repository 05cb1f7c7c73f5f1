"""Subcommands of `hab-tasks`: one module each, with a dataclass of options and a `run` method."""

from hab_tasks.commands.assets import Assets
from hab_tasks.commands.check import Check
from hab_tasks.commands.convert import Convert
from hab_tasks.commands.demo import Demo
from hab_tasks.commands.docs import Docs
from hab_tasks.commands.episodes import Episodes
from hab_tasks.commands.figures import Figures
from hab_tasks.commands.list import List
from hab_tasks.commands.vary import Vary
from hab_tasks.console import Command

COMMANDS: dict[str, type[Command]] = {
    "list": List,
    "demo": Demo,
    "check": Check,
    "vary": Vary,
    "assets": Assets,
    "episodes": Episodes,
    "figures": Figures,
    "convert": Convert,
    "docs": Docs,
}
"""Subcommand -> options, in the order of `--help`."""

__all__ = ["COMMANDS", "Command"]
