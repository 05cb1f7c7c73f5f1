"""The console script `hab-ppo`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from hab_ppo.commands import (
    CardsCommand,
    DemonstrateCommand,
    EvalCommand,
    GroundCommand,
    PlotCommand,
    ShipCommand,
    StudyCommand,
)
from hab_ppo.extensions import extensions
from hab_ppo.recipes import find_recipe, recipe_names
from hab_ppo.train_command import TrainCommand
from hab_tasks.io.console import Command, run_script

DESCRIPTION = "Recurrent PPO and DD-PPO for the skills of the Home Assistant Benchmark."


@dataclass(frozen=True, kw_only=True)
class ListCommand(Command):
    """Options of `hab-ppo list`."""

    help: ClassVar[str] = "Lists the recipes.\n\nExample:\n  hab-ppo list"

    def run(self) -> int:
        """Prints a line for each recipe."""
        for name in recipe_names():
            recipe = find_recipe(name)
            config = recipe.env
            print(
                f"{name:24s} {config.env:22s} {config.control_mode:14s} {config.obs_mode:11s} "
                f"{recipe.total_steps:>11,} steps  {recipe.about}"
            )
        return 0


COMMANDS: dict[str, type[Command]] = {
    "train": TrainCommand,
    **{name: found.load() for name, found in extensions("commands").items()},
    "ground": GroundCommand,
    "demonstrate": DemonstrateCommand,
    "eval": EvalCommand,
    "plot": PlotCommand,
    "study": StudyCommand,
    "list": ListCommand,
    "ship": ShipCommand,
    "cards": CardsCommand,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs `hab-ppo`; returns its exit status."""
    return run_script("hab-ppo", COMMANDS, arguments, DESCRIPTION)
