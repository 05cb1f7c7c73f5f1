"""The command `hab-ppo navigator`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from hab_tasks.io.console import Command


@dataclass(frozen=True, kw_only=True)
class NavigatorCommand(Command):
    """Options of `hab-ppo navigator`."""

    help: ClassVar[str] = """Trains the navigator of Navigate: a map, a goal network, shortest ways.

Example:
  hab-ppo navigator --workers 2 --out runs/navigator

The same command continues an interrupted run after its last round. To play with the weights:
  hab-eval run --agent hab_ppo:navigator --option weights=runs/navigator \\
    --env HabNavigate-v1 --out DIR"""
    work: ClassVar[str] = "hab_navigator.training:run"

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """The run's folder."""
    rounds: Annotated[int, tyro.conf.arg(metavar="N")] = 4
    """Rounds of practice, each followed by a fit."""
    episodes: Annotated[int, tyro.conf.arg(metavar="N")] = 1000
    """Episodes of a round."""
    epochs: Annotated[int, tyro.conf.arg(metavar="N")] = 10
    """Epochs of a fit."""
    training_episodes: Annotated[int, tyro.conf.arg(metavar="N")] = 3000
    """Number of different episodes, of which practice draws."""
    rows: Annotated[int, tyro.conf.arg(metavar="N")] = 10
    """Simulations of each process."""
    workers: Annotated[int, tyro.conf.arg(metavar="W")] = 2
    """Number of processes."""
    seed: Annotated[int, tyro.conf.arg(metavar="S")] = 0
    """Seed of the run."""
    scene_dataset: Annotated[str, tyro.conf.arg(metavar="NAME|PATH")] = "apartment"
    """`apartment` (included), or a ReplicaCAD folder."""
    objects: Annotated[str | None, tyro.conf.arg(metavar="PATH")] = None
    """A YCB folder, instead of the included objects."""
    force: bool = False
    """Replace the run in DIR."""
    verbose: bool = False
    """Print the traceback of an error in an environment."""
