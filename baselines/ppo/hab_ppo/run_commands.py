"""The commands `hab-ppo eval` and `hab-ppo plot`, of what a run has learnt."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from hab_tasks.console import Command

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
