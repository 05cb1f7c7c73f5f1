"""The commands `hab-ppo ship` and `hab-ppo cards`, for those who maintain the package's weights."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from hab_ppo.extensions import extensions
from hab_ppo.progress import say
from hab_tasks.console import Command
from hab_tasks.files import written_aside


@dataclass(frozen=True, kw_only=True)
class ShipCommand(Command):
    """Options of `hab-ppo ship`."""

    help: ClassVar[str] = """Adds the best weights of a run to the package, under its recipe's name.

Example:
  hab-ppo ship runs/pick_blind
  hab-ppo cards"""

    run_folder: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="DIR")]
    """The run's folder."""

    def run(self) -> int:
        """Writes the file of weights."""
        from hab_ppo import shipping  # loads torch

        others = [found.load() for found in extensions("shipping").values()]
        module = next((one for one in others if one.is_run(self.run_folder)), shipping)
        out = module.ship(self.run_folder)
        say(f"wrote {out}, {out.stat().st_size / 1e6:.1f} MB; hab-ppo cards writes its card")
        return 0


@dataclass(frozen=True, kw_only=True)
class CardsCommand(Command):
    """Options of `hab-ppo cards`."""

    help: ClassVar[str] = """Writes the model cards of the weights that ship, with their results.

Example:
  hab-ppo cards --check"""

    submissions: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder of run.json files; that of the leaderboard if not given."""
    check: bool = False
    """Only report cards that are out of date, with exit status 1."""

    def run(self) -> int:
        """Writes or compares the cards."""
        from hab_ppo import cards  # loads the simulator

        records = cards.evaluations(self.submissions)
        texts = cards.cards(records)
        curves = set(texts)
        for found in extensions("shipping").values():
            texts |= found.load().cards(records)
        stale = []
        for path, text in texts.items():
            picture = path.with_suffix(".png")
            there = path.is_file() and (path not in curves or picture.is_file())
            if there and path.read_text(encoding="utf-8") == text:
                continue
            stale.append(path.stem)
            if not self.check:
                with written_aside(path) as scratch:
                    scratch.write_text(text, encoding="utf-8")
                if path in curves:
                    cards.draw_card_curve(path.stem, picture)
        state = "out of date" if self.check else "written"
        say(f"{state}: {', '.join(stale)}" if stale else "all cards are up to date")
        return int(self.check and bool(stale))
