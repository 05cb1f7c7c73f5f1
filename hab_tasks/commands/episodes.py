"""`hab-tasks episodes`: generates an episode file."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from hab_tasks.console import Command
from hab_tasks.errors import HabError
from hab_tasks.executors import ExecutorChoice, open_executor
from hab_tasks.files import check_file
from hab_tasks.generation_lines import GenerationLines, progress_bar
from hab_tasks.option_values import LARGEST_SEED, MOST_WORKERS, whole
from hab_tasks.registration import imported_id

EPISODE_ENDINGS = (".json", ".json.gz")


@dataclass(frozen=True, kw_only=True)
class Episodes(ExecutorChoice, Command):
    """Options of `hab-tasks episodes`."""

    help: ClassVar[str] = """Generates an episode file; equal options give equal episodes.

Example:
  hab-tasks episodes --env HabPick-v1 --split train --count 100 --seed 0 --out pick.json.gz

On a Ray cluster, from one of its nodes:
  hab-tasks episodes --env HabPick-v1 --count 100000 --workers 64 --executor ray --address auto \\
    --out pick.json.gz"""

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
    resume: bool = False
    """Continue an interrupted run with the same options."""

    def run(self) -> int:
        """Generates and writes the file, then prints the rejected samples by reason."""
        from hab_tasks.episodes import EpisodeRequest, open_source
        from hab_tasks.episodes.journal import EpisodeJournal, journal_of

        self._check()
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
        journal = EpisodeJournal(journal_of(self.out), source.configuration())
        journal.open(resume=self.resume, force=self.force)
        source.restore(journal.entries, self.count)
        lines = GenerationLines(partial(print, flush=True))
        with (
            open_executor(self, self.workers) as executor,
            progress_bar("episode", lines.show) as show,
        ):
            source.prepare(self.count, executor, show, journal.append)
        source.save(self.count, self.out)
        journal.remove()
        print(f"wrote {self.count} episodes ({source.split}) to {self.out}")
        for reason, times in sorted(source.rejections.items()):
            print(f"  rejected {times}: {reason}")
        return 0

    def advice(self) -> str:
        """Returns how to continue."""
        from hab_tasks.episodes.journal import journal_of

        kept = journal_of(self.out)
        return f"Use --resume to continue; episodes are kept in {kept}." if kept.exists() else ""

    def _check(self) -> None:
        from hab_tasks.episodes.journal import journal_of
        from hab_tasks.episodes.source import UNLIMITED

        imported_id(self.env)
        self.check_executor()
        whole("--count", self.count, 1, UNLIMITED)
        whole("--seed", self.seed, 0, LARGEST_SEED)
        whole("--workers", self.workers, 1, MOST_WORKERS)
        if self.resume and self.force:
            raise HabError("--resume keeps the generated episodes, --force drops them: give one.")
        check_ending(self.out)
        unfinished = self.resume and journal_of(self.out).exists()
        check_file(self.out, force=self.force or unfinished)


def check_ending(file: Path) -> None:
    """Raises HabError for an episode file without a valid suffix."""
    if not file.name.endswith(EPISODE_ENDINGS):
        raise HabError(f"--out {file}: an episode file must end in {' or '.join(EPISODE_ENDINGS)}.")
