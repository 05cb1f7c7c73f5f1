"""`hab-tasks episodes`: makes an episode file."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro
from tqdm import tqdm

from hab_tasks.commands.base import Command, check_ending
from hab_tasks.errors import UnknownNameError
from hab_tasks.files import check_file
from hab_tasks.option_values import LARGEST_SEED, MOST_WORKERS, whole
from hab_tasks.registration import ENTRY_POINTS


@dataclass(frozen=True, kw_only=True)
class Episodes(Command):
    """Options of `hab-tasks episodes`."""

    help: ClassVar[str] = """Makes an episode file; the same options always give the same episodes.

Example:
  hab-tasks episodes --env HabPick-v1 --split train --count 100 --seed 0 --out pick.json.gz"""

    env: Annotated[str, tyro.conf.arg(metavar="ID")]
    """Environment id; `hab-tasks list` shows all."""
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """The episode file, .json or .json.gz."""
    split: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """train, val or test, instead of the most unseen one that the dataset has."""
    scene: Annotated[str | None, tyro.conf.arg(metavar="ID")] = None
    """Only this layout."""
    count: Annotated[int, tyro.conf.arg(metavar="N")] = 50
    """Number of episodes."""
    seed: Annotated[int, tyro.conf.arg(metavar="S")] = 0
    """Seed of the episodes."""
    scene_dataset: Annotated[str, tyro.conf.arg(metavar="NAME|PATH")] = "apartment"
    """`apartment`, which is shipped, or a ReplicaCAD folder."""
    objects: Annotated[str | None, tyro.conf.arg(metavar="PATH")] = None
    """A YCB folder, instead of the shipped objects."""
    novel: Annotated[str | None, tyro.conf.arg(metavar="WHAT")] = None
    """objects or receptacles: those kept for evaluating generalisation."""
    workers: Annotated[int, tyro.conf.arg(metavar="W")] = 1
    """Number of processes; changes no episode."""
    force: bool = False
    """Replace FILE."""

    def run(self) -> int:
        """Generates and writes the file, then prints what was refused and why."""
        from hab_tasks.episodes import EpisodeRequest, open_source
        from hab_tasks.episodes.source import UNLIMITED

        if self.env not in ENTRY_POINTS:
            raise UnknownNameError("env", self.env, ENTRY_POINTS)
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
            print(f"  refused {times}: {reason}")
        return 0
