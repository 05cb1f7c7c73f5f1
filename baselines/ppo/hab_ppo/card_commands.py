"""The commands `hab-ppo ship` and `hab-ppo cards`, for those who maintain the package's weights."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from hab_tasks.console import Command


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
