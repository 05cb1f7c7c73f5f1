"""Options of the commands of `hab-ppo` besides `train`."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from hab_tasks.io.console import Command

DEMONSTRATE_HELP = """Makes demonstrations for a recipe.

They are an agent's solved episodes, retimed and replayed.

Example:
  hab-ppo demonstrate close_drawer_blind --workers 2 --out demonstrations.safetensors
  hab-ppo train close_drawer_blind --demonstrations demonstrations.safetensors --out runs/close"""


@dataclass(frozen=True, kw_only=True)
class DemonstrateCommand(Command):
    """Options of `hab-ppo demonstrate`."""

    help: ClassVar[str] = DEMONSTRATE_HELP
    work: ClassVar[str] = "hab_ppo.warm_start:run"

    recipe: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="NAME")]
    """A recipe of `hab-ppo list`, or `module:NAME`; its training episodes are played."""
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """Output file, .safetensors."""
    agent: Annotated[str, tyro.conf.arg(metavar="MODULE:FACTORY")] = "hab_spa:spa_priv"
    """The agent that demonstrates."""
    count: Annotated[int, tyro.conf.arg(metavar="N")] = 300
    """Number of demonstrations."""
    noise: Annotated[float, tyro.conf.arg(metavar="SHARE")] = 0.5
    """Standard deviation of the noise on the executed actions, as a share of the largest."""
    workers: Annotated[int, tyro.conf.arg(metavar="W")] = 2
    """Number of processes."""
    seed: Annotated[int, tyro.conf.arg(metavar="S")] = 0
    """Seed of the noise."""
    episodes: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Number of training episodes, instead of the recipe's."""
    force: bool = False
    """Replace FILE."""
    verbose: bool = False
    """Print the traceback of an error in an episode."""


EVAL_HELP = """Plays episodes with the best weights of a run, greedily.

Example:
  hab-ppo eval runs/pick_blind --episodes 100

For a run.json with videos, failures and stages, use the weights as an agent:
  hab-eval run --agent hab_ppo:policy --option weights=runs/pick_blind --env HabPick-v1 --out DIR"""


@dataclass(frozen=True, kw_only=True)
class EvalCommand(Command):
    """Options of `hab-ppo eval`."""

    help: ClassVar[str] = EVAL_HELP
    work: ClassVar[str] = "hab_ppo.play:run"

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


PLOT_HELP = """Draws the learning curves of one or more runs.

Example:
  hab-ppo plot runs/pick_blind runs/pick_blind_paper --out curves.png"""


@dataclass(frozen=True, kw_only=True)
class PlotCommand(Command):
    """Options of `hab-ppo plot`."""

    help: ClassVar[str] = PLOT_HELP
    work: ClassVar[str] = "hab_ppo.curves:run"

    runs: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="DIR")]
    """Folders of runs."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Output file; curves.png in the first run's folder if not given."""
    minutes: bool = False
    """Draw over wall time, with that of demonstrations or distillation, instead of steps."""
    force: bool = False
    """Replace FILE."""


@dataclass(frozen=True, kw_only=True)
class ShipCommand(Command):
    """Options of `hab-ppo ship`."""

    help: ClassVar[str] = """Adds the best weights of a run to the package, under its recipe's name.

Example:
  hab-ppo ship runs/pick_blind
  hab-ppo cards"""
    work: ClassVar[str] = "hab_ppo.shipping:run"

    run_folder: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="DIR")]
    """The run's folder."""


@dataclass(frozen=True, kw_only=True)
class CardsCommand(Command):
    """Options of `hab-ppo cards`."""

    help: ClassVar[str] = """Writes the model cards of the weights that ship, with their results.

Example:
  hab-ppo cards --check"""
    work: ClassVar[str] = "hab_ppo.cards:run"

    submissions: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder of run.json files; that of the leaderboard if not given."""
    check: bool = False
    """Only report cards that are out of date, with exit status 1."""


@dataclass(frozen=True, kw_only=True)
class StudyCommand(Command):
    """Options of `hab-ppo study`."""

    help: ClassVar[str] = """Repeats a study of the paper's supplement.

Example:
  hab-ppo study f5 --out runs/f5

f1 sensors, f2 efficiency and force limit, f3 cameras, f4 saliency, f5 delay, f6 action spaces;
fig26, fig27 and fig28 learning curves. Writes README.md with table and figure, and the result of
every evaluation; the same command continues an interrupted study."""
    work: ClassVar[str] = "hab_ppo.studies.registry:run"

    study: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="NAME")]
    """f1 to f6, fig26, fig27 or fig28."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """The study's folder."""
    scale: Annotated[str, tyro.conf.arg(metavar="NAME")] = "quick"
    """quick: a check of the study in minutes; full: up to six hours of two cores."""
    workers: Annotated[int, tyro.conf.arg(metavar="W")] = 2
    """Number of trainings at a time, and of processes of an evaluation."""
    verbose: bool = False
    """Print the traceback of an error in an environment."""

    def command(self) -> str:
        """Returns the command of this study, whatever its folder."""
        return f"hab-ppo study {shlex.quote(self.study)} --scale {self.scale} --out DIR"

    def advice(self) -> str:
        """Returns how to continue."""
        return f"The work so far is kept in {self.out}; the same command continues it."


@dataclass(frozen=True, kw_only=True)
class GroundCommand(Command):
    """Options of `hab-ppo ground`."""

    help: ClassVar[str] = """Trains pick_language: where an object that is told is seen.

Example:
  hab-ppo ground --workers 2 --out runs/pick_language

Renders the first views of training episodes in color, which needs a Vulkan driver, and fits a
network to them. To pick with its weights:
  hab-eval run --agent hab_ppo:pick_language --option weights=runs/pick_language \\
    --env HabPick-v1 --out DIR"""
    work: ClassVar[str] = "hab_ppo.grounding_training:run"

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """The run's folder."""
    episodes: Annotated[int, tyro.conf.arg(metavar="N")] = 4000
    """Number of training episodes."""
    epochs: Annotated[int, tyro.conf.arg(metavar="N")] = 7
    """Epochs of the fit."""
    workers: Annotated[int, tyro.conf.arg(metavar="W")] = 2
    """Number of processes, and of threads of the fit."""
    seed: Annotated[int, tyro.conf.arg(metavar="S")] = 0
    """Seed of the fit."""
    scene_dataset: Annotated[str, tyro.conf.arg(metavar="NAME|PATH")] = "apartment"
    """`apartment` (included), or a ReplicaCAD folder."""
    objects: Annotated[str | None, tyro.conf.arg(metavar="PATH")] = None
    """A YCB folder, instead of the included objects."""
    force: bool = False
    """Replace the run in DIR."""
    verbose: bool = False
    """Print the traceback of an error in an environment."""
