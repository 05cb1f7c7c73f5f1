"""The console script `hab-ppo`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro
from hab_eval.records.stats import wilson_interval

from hab_ppo.card_commands import CardsCommand, ShipCommand
from hab_ppo.demonstrate_command import DemonstrateCommand
from hab_ppo.extensions import extensions
from hab_ppo.limits import MOST_EPISODES, MOST_RANKS, MOST_ROWS
from hab_ppo.recipes import find_recipe, recipe_names
from hab_ppo.train_command import TrainCommand
from hab_tasks.console import Command, run_script
from hab_tasks.errors import OptionError
from hab_tasks.files import check_file
from hab_tasks.option_values import LARGEST_SEED, whole

DESCRIPTION = "Recurrent PPO and DD-PPO for the skills of the Home Assistant Benchmark."

EVAL_HELP = """Plays episodes with the best weights of a run, greedily.

Example:
  hab-ppo eval runs/pick_blind --episodes 100

For a run.json with videos, failures and stages, use the weights as an agent:
  hab-eval run --agent hab_ppo:policy --option weights=runs/pick_blind --env HabPick-v1 --out DIR"""


@dataclass(frozen=True, kw_only=True)
class EvalCommand(Command):
    """Options of `hab-ppo eval`."""

    help: ClassVar[str] = EVAL_HELP

    weights: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="PATH")]
    """A run's folder, or a file of weights."""
    episodes: Annotated[int, tyro.conf.arg(metavar="N")] = 100
    """Number of episodes."""
    split: Annotated[str, tyro.conf.arg(metavar="NAME")] = "val"
    """Split of the episodes."""
    seed: Annotated[int, tyro.conf.arg(metavar="S")] = 0
    """Seed of the episodes."""
    rows: Annotated[int, tyro.conf.arg(metavar="N")] = 16
    """Simulations side by side."""
    workers: Annotated[int, tyro.conf.arg(metavar="W")] = 2
    """Number of processes."""
    verbose: bool = False
    """Print the traceback of an error in an environment."""

    def run(self) -> int:
        """Plays the episodes and prints the success rate."""
        whole("--episodes", self.episodes, 1, MOST_EPISODES)
        whole("--rows", self.rows, 1, MOST_ROWS)
        whole("--workers", self.workers, 1, MOST_RANKS)
        whole("--seed", self.seed, 0, LARGEST_SEED)
        from hab_ppo.play import play  # loads the simulator

        result = play(
            self.weights,
            split=self.split,
            episodes=self.episodes,
            seed=self.seed,
            rows=self.rows,
            workers=self.workers,
        )
        low, high = wilson_interval(result.successes, result.episodes)
        print(
            f"success {result.successes / result.episodes:.1%} ({result.successes} of "
            f"{result.episodes}, 95 % interval {low:.1%} to {high:.1%})"
        )
        print(f"return {result.mean_return:.2f}, {result.mean_steps:.0f} steps (means)")
        return 0


PLOT_HELP = """Draws the learning curves of one or more runs.

Example:
  hab-ppo plot runs/pick_blind runs/pick_blind_paper --out curves.png"""


@dataclass(frozen=True, kw_only=True)
class PlotCommand(Command):
    """Options of `hab-ppo plot`."""

    help: ClassVar[str] = PLOT_HELP

    runs: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="DIR")]
    """Folders of runs."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Output file; curves.png in the first run's folder if not given."""
    minutes: bool = False
    """Draw over wall time, with that of demonstrations or distillation, instead of steps."""
    force: bool = False
    """Replace FILE."""

    def run(self) -> int:
        """Draws the picture."""
        from hab_ppo.curves import draw_curves  # loads the simulator

        if not self.runs:
            raise OptionError("Give at least one folder of a run.")
        out = self.runs[0] / "curves.png" if self.out is None else self.out
        # The default file is the run's own, and is drawn again as the run goes on.
        check_file(out, force=self.force or self.out is None)
        draw_curves(self.runs, out, minutes=self.minutes)
        print(f"wrote {out}")
        return 0


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
    "demonstrate": DemonstrateCommand,
    "eval": EvalCommand,
    "plot": PlotCommand,
    "list": ListCommand,
    "ship": ShipCommand,
    "cards": CardsCommand,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs `hab-ppo`; returns its exit status."""
    return run_script("hab-ppo", COMMANDS, arguments, DESCRIPTION)
