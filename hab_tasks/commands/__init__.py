"""The subcommands of `hab-tasks`: one module each, one dataclass of options that runs itself."""

from hab_tasks.commands.assets import Assets
from hab_tasks.commands.base import Command
from hab_tasks.commands.check import Check
from hab_tasks.commands.convert import Convert
from hab_tasks.commands.demo import Demo
from hab_tasks.commands.docs import Docs
from hab_tasks.commands.episodes import Episodes
from hab_tasks.commands.figures import Figures
from hab_tasks.commands.list import List
from hab_tasks.commands.vary import Vary

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
"""Subcommand -> its options, in the order in which `--help` shows them."""

__all__ = ["COMMANDS", "Command"]
