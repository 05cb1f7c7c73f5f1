"""The commands `hab-eval submit`, `verify` and `film`."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import tyro

from hab_tasks.console import Command
from hab_tasks.errors import OptionError
from hab_tasks.files import check_file, scratch_folder, written_aside

if TYPE_CHECKING:
    from hab_eval.evaluate import Reporter
    from hab_eval.results import EpisodeResult, RunRecord
    from hab_eval.submissions.replay import Difference, Replay

EXIT_DIFFERENT = 1

SUBMIT_HELP = """Checks a run and adds it to the leaderboard.

Example:
  hab-eval submit runs/pick

A submission has a clean commit of this repository, and of the agent's if it is in one, at least 50
episodes, and the episodes of its protocol (env, scene dataset, split, seed). It is copied to
<agent>-<env>-<dataset>-seed<S>.json in the submissions folder, and LEADERBOARD.md and its web page
are generated again."""

VERIFY_HELP = """Repeats episodes of a submission and compares everything that it says of them.

Example:
  hab-eval verify spa_priv-pick-apartment-seed2026 --episodes 10

The episodes are repeated with the same seeds. Each is identical, has the same outcome and steps
(return and scores within 1 %, as on another processor), or is different. The exit status is 1 if
one is different, if the agent's weights are others, at the same commit also its code, or if the
seconds differ by more than a factor of ten."""

FILM_HELP = """Repeats episodes of a submission and records videos of them.

Example:
  hab-eval film spa_priv-pick-apartment-seed2026 --out videos
  hab-eval site --videos videos --out site

By default, records the first success and the first failure of each category, as shown by the
results site. Needs a Vulkan device (software is enough). Videos are written to
DIR/<submission>/video_<index>_<episode id>.mp4. A video with another outcome or number of steps
than recorded is not kept. The exit status is that of `verify`."""


@dataclass(frozen=True, kw_only=True)
class SubmitCommand(Command):
    """Options of `hab-eval submit`."""

    help: ClassVar[str] = SUBMIT_HELP

    run_path: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """The run: its folder (the --out of hab-eval run) or its run.json."""
    submissions: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder of submissions; this checkout's if not given."""
    name: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """Name of the submission, instead of <agent>-<env>-<dataset>-seed<S>."""
    force: bool = False
    """Replace a submission of the same name."""

    def run(self) -> int:
        """Checks and copies the run, then writes the leaderboard."""
        from hab_eval.failures import read_runs
        from hab_eval.leaderboard import (
            AGAIN_FILE,
            default_submissions,
            leaderboard_texts,
            with_submission,
        )
        from hab_eval.results import write_record
        from hab_eval.submissions.checks import check_submission, cleanliness
        from hab_eval.submissions.naming import check_name, submission_name

        (record,) = read_runs([self.run_path])
        check_submission(record, str(self.run_path))
        folder = self.submissions or default_submissions()
        stem = check_name(self.name) if self.name is not None else submission_name(record)
        target = folder / f"{stem}.json"
        found = with_submission(folder, target.name, record)
        texts = leaderboard_texts(found, folder.parent / "LEADERBOARD.md")
        if (folder.parent / AGAIN_FILE).is_file():
            texts[folder.parent / AGAIN_FILE] = json.dumps(found.again, indent=1) + "\n"
        _check_new(target, force=self.force)
        for path in texts:
            check_file(path, force=True)
        write_record(target, record)
        print(f"wrote {target}")
        print(cleanliness(record))
        for path, text in texts.items():
            with written_aside(path) as scratch:
                scratch.write_text(text, encoding="utf-8")
            print(f"wrote {path}")
        print("Tables within pages: hab-eval table --pages README.md --pages docs/status.md")
        return 0


@dataclass(frozen=True, kw_only=True)
class ReplayCommand(Command):
    """Options of the commands that repeat episodes of a submission."""

    submission: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SUBMISSION")]
    """The submission: its name in the submissions folder, or a run (folder or run.json)."""
    submissions: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder of submissions; this checkout's if not given."""
    episode: Annotated[
        tuple[int, ...], tyro.conf.arg(metavar="INDEX"), tyro.conf.UseAppendAction
    ] = ()
    """Index of an episode to repeat, from 0, instead of the command's own choice; can be
    repeated."""
    scene_dataset: Annotated[str | None, tyro.conf.arg(metavar="PATH")] = None
    """Folder of the run's scene dataset on this machine; not needed for `apartment`."""
    objects: Annotated[str | None, tyro.conf.arg(metavar="PATH")] = None
    """Folder of the run's object dataset; not needed for the shipped objects."""
    option: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="NAME=VALUE"), tyro.conf.UseAppendAction
    ] = ()
    """Replaces an agent option of the run, e.g. a file that has another path here; can be
    repeated."""
    device: Annotated[str, tyro.conf.arg(metavar="NAME")] = "cpu"
    """Device of the agent's networks, e.g. cuda."""
    workers: Annotated[int, tyro.conf.arg(metavar="W")] = 1
    """Number of worker processes; does not change results."""
    verbose: bool = False
    """Print the traceback of an error in an episode."""

    def read(self) -> tuple[str, RunRecord]:
        """Returns the name and the content of the submission."""
        from hab_eval.results import read_record
        from hab_eval.submissions.naming import find_submission

        path = find_submission(self.submission, self.submissions)
        name = path.resolve().parent.name if path.name == "run.json" else path.stem
        return name, read_record(path)

    def chosen(self, record: RunRecord) -> tuple[int, ...]:
        """Returns the indices given by --episode."""
        for index in self.episode:
            if not 0 <= index < len(record.episodes):
                valid = f"from 0 to {len(record.episodes) - 1}"
                raise OptionError.of_value("--episode", index, valid)
        return tuple(sorted(set(self.episode)))

    def request(self, record: RunRecord, indices: Sequence[int], videos: Path | None) -> Replay:
        """Returns which episodes to repeat, and how."""
        from hab_eval.config import parse_options
        from hab_eval.evaluate import MOST_WORKERS
        from hab_eval.submissions.replay import Replay
        from hab_tasks.option_values import whole

        whole("workers", self.workers, 1, MOST_WORKERS)
        return Replay(
            record=record,
            indices=indices,
            scene_dataset=self.scene_dataset,
            objects=self.objects,
            options=parse_options(self.option),
            device=self.device,
            workers=self.workers,
            videos=videos,
        )

    def repeat(self, request: Replay) -> tuple[list[EpisodeResult], list[Difference]]:
        """Repeats the episodes, with progress."""
        from hab_eval.progress import make_reporter
        from hab_eval.submissions.replay import replay

        reporter: Reporter = make_reporter(
            terminal=sys.stderr.isatty(),
            verbose=self.verbose,
            write_line=lambda line: print(line, flush=True),
        )
        return replay(request, reporter)


@dataclass(frozen=True, kw_only=True)
class VerifyCommand(ReplayCommand):
    """Options of `hab-eval verify`."""

    help: ClassVar[str] = VERIFY_HELP

    episodes: Annotated[int, tyro.conf.arg(metavar="N")] = 10
    """Number of episodes to repeat, drawn at random."""
    sample_seed: Annotated[int, tyro.conf.arg(metavar="S")] = 0
    """Seed of the draw."""

    def run(self) -> int:
        """Repeats the episodes and prints the comparison."""
        from hab_eval.plain_text import show
        from hab_eval.submissions.report import (
            DIFFERENT,
            closing_lines,
            comparison_table,
            draw,
            level_of,
        )

        name, record = self.read()
        drawn = draw(len(record.episodes), self.episodes, self.sample_seed)
        indices = self.chosen(record) or drawn
        repeated, differences = self.repeat(self.request(record, indices, None))
        recorded = [record.episodes[index] for index in indices]
        show(comparison_table(name, recorded, repeated))
        for line in closing_lines(record, len(indices), differences):
            print(line)
        return 0 if level_of(differences) != DIFFERENT else EXIT_DIFFERENT


@dataclass(frozen=True, kw_only=True)
class FilmCommand(ReplayCommand):
    """Options of `hab-eval film`."""

    help: ClassVar[str] = FILM_HELP

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Folder for the videos; they are written to a folder in it with the submission's name."""
    force: bool = False
    """Replace existing videos."""

    def run(self) -> int:
        """Repeats and records the episodes."""
        from hab_eval.submissions.report import DIFFERENT, closing_lines, level_of
        from hab_eval.video_names import highlights, video_name

        name, record = self.read()
        indices = self.chosen(record) or highlights(record)
        stems = {index: video_name(index, record.episodes[index].id) for index in indices}
        folder = self.out / name
        for stem in stems.values():
            check_file(folder / f"{stem}.mp4", force=self.force)
        with scratch_folder(self.out) as scratch:
            _, differences = self.repeat(self.request(record, indices, scratch))
            different = {one.episode for one in differences if not one.small}
            for index, stem in stems.items():
                if record.episodes[index].id not in different:
                    _move_video(scratch / f"{stem}.mp4", folder)
                    print(f"wrote {folder / f'{stem}.mp4'}")
        for line in closing_lines(record, len(indices), differences):
            print(line)
        return 0 if level_of(differences) != DIFFERENT else EXIT_DIFFERENT


def _check_new(target: Path, *, force: bool) -> None:
    """Checks that a submission does not exist, or may be replaced."""
    if target.exists() and not force:
        raise OptionError(
            f"{target} exists; give --force to replace it, or --name for another name."
        )
    check_file(target, force=force)


def _move_video(video: Path, folder: Path) -> None:
    """Moves a video and its first frame; both are on the same disk."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in (video.with_suffix(".png"), video):
        path.replace(folder / path.name)
