"""The command `hab-ppo demonstrate`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from hab_tasks.console import Command

HELP = """Makes demonstrations for a recipe: an agent's solved episodes, retimed and replayed.

Example:
  hab-ppo demonstrate close_drawer_blind --workers 2 --out demonstrations.safetensors
  hab-ppo train close_drawer_blind --demonstrations demonstrations.safetensors --out runs/close"""


@dataclass(frozen=True, kw_only=True)
class DemonstrateCommand(Command):
    """Options of `hab-ppo demonstrate`."""

    help: ClassVar[str] = HELP
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
