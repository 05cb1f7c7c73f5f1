"""`hab-tasks episodes`: generates an episode file."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro
from tqdm import tqdm

from hab_tasks.commands.endings import check_ending
from hab_tasks.console import Command
from hab_tasks.files import check_file
from hab_tasks.option_values import LARGEST_SEED, MOST_WORKERS, whole
from hab_tasks.registration import imported_id


@dataclass(frozen=True, kw_only=True)
class Episodes(Command):
    """Options of `hab-tasks episodes`."""

    help: ClassVar[str] = """Generates an episode file; equal options give equal episodes.

Example:
  hab-tasks episodes --env HabPick-v1 --split train --count 100 --seed 0 --out pick.json.gz"""

    env: Annotated[str, tyro.conf.arg(metavar="ID")]
    """Environment id; see `hab-tasks list`."""
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """Output file, .json or .json.gz."""
    split: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """train, val or test; default: the least-seen split available."""
    scene: Annotated[str | None, tyro.conf.arg(metavar="ID")] = None
    """Only this layout."""
    count: Annotated[int, tyro.conf.arg(metavar="N")] = 50
    """Number of episodes."""
    seed: Annotated[int, tyro.conf.arg(metavar="S")] = 0
    """Seed of the episodes."""
    scene_dataset: Annotated[str, tyro.conf.arg(metavar="NAME|PATH")] = "apartment"
    """`apartment` (included), or a ReplicaCAD folder."""
    objects: Annotated[str | None, tyro.conf.arg(metavar="PATH")] = None
    """A YCB folder, instead of the included objects."""
    novel: Annotated[str | None, tyro.conf.arg(metavar="WHAT")] = None
    """objects or receptacles: use those held out for evaluating generalisation."""
    workers: Annotated[int, tyro.conf.arg(metavar="W")] = 1
    """Number of worker processes; does not change the episodes."""
    force: bool = False
    """Replace FILE."""

    def run(self) -> int:
        """Generates and writes the file, then prints the rejected samples by reason."""
        from hab_tasks.episodes import EpisodeRequest, open_source
        from hab_tasks.episodes.source import UNLIMITED

        imported_id(self.env)
        whole("--count", self.count, 1, UNLIMITED)
        whole("--seed", self.seed, 0, LARGEST_SEED)
        whole("--workers", self.workers, 1, MOST_WORKERS)
        check_ending(self.out)
        check_file(self.out, force=self.force)
        source = open_source(
            EpisodeRequest(
                env_id=self.env,
                scene_dataset=self.scene_dataset,
                objects=self.objects,
                split=self.split,
                scene=self.scene,
                seed=self.seed,
                novel=self.novel,
            )
        )
        with tqdm(total=self.count, unit="episode", disable=not sys.stderr.isatty()) as bar:

            def show(ready: int, _: int) -> None:
                bar.update(ready - bar.n)

            source.prepare(self.count, self.workers, show)
        source.save(self.count, self.out)
        print(f"wrote {self.count} episodes ({source.split}) to {self.out}")
        for reason, times in sorted(source.rejections.items()):
            print(f"  rejected {times}: {reason}")
        return 0
