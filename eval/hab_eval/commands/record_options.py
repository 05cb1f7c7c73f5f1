"""Options of the commands that read, publish, repeat and show results."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from hab_tasks.io.console import Command

TABLE_HELP = """Generates LEADERBOARD.md and its web page from the submissions.

Example:
  hab-eval table --pages README.md

Tables within a page stand between <!-- results: AGENT --> and <!-- end of results -->. With
--check, nothing is written; the exit status says whether the files are up to date."""

FAILURES_HELP = """Breaks down the failures of one or several runs by category (table and figure).

Example:
  hab-eval failures runs/tidy_house runs/set_table/run.json --out failures.png"""

COMPARE_HELP = """Compares two runs on their common episodes.

Prints counts, McNemar's exact test, and the episodes that only one of them solves, with their
videos.

Example:
  hab-eval compare runs/mine runs/baseline"""

SITE_HELP = """Generates the results site, a folder of static pages, from the submissions.

Example:
  hab-eval site --out site
  python -m http.server --directory site

The pages load nothing from a network and also work when opened as files. --videos adds videos,
as recorded by hab-eval film: DIR/<submission>/video_<index>_<episode id>.mp4."""

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


VIEW_HELP = """Shows an episode in 3-D in the browser (pip install 'hab-eval[view]').

Example:
  hab-eval view runs/pick --episode 3 --out runs/pick/view_3.html
  hab-eval site runs/pick --out site

The episode is repeated with the agent. The page has a time slider, images of the cameras, contacts,
and the beliefs of an agent that reports them; it needs neither a GPU nor a Vulkan device. The exit
status is that of `verify`."""


@dataclass(frozen=True, kw_only=True)
class TableCommand(Command):
    """Options of `hab-eval table`."""

    help: ClassVar[str] = TABLE_HELP
    work: ClassVar[str] = "hab_eval.commands.pages:write_tables"

    submissions: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder of submitted run.json files; this checkout's if not given."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Markdown file, LEADERBOARD.md beside the submissions if not given; the web page has the same
    name with .html."""
    pages: Annotated[
        tuple[Path, ...], tyro.conf.arg(metavar="FILE"), tyro.conf.UseAppendAction
    ] = ()
    """A Markdown page whose result tables are regenerated as well; can be repeated."""
    benchmarks: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder of the benchmark reports that these pages show, instead of the checkout's own."""
    check: bool = False
    """Only compare; the exit status is 1 if a file is out of date."""


@dataclass(frozen=True, kw_only=True)
class FailuresCommand(Command):
    """Options of `hab-eval failures`."""

    help: ClassVar[str] = FAILURES_HELP
    work: ClassVar[str] = "hab_eval.commands.pages:show_failures"

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="RUN...")]
    """Runs to compare: run folders (their --out) or run.json files."""
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """Output figure, a .png file."""
    force: bool = False
    """Overwrite FILE."""


@dataclass(frozen=True, kw_only=True)
class CompareCommand(Command):
    """Options of `hab-eval compare`."""

    help: ClassVar[str] = COMPARE_HELP
    work: ClassVar[str] = "hab_eval.commands.pages:show_comparison"

    first: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="A")]
    """A run: its folder (the --out of hab-eval run), its run.json, or a submission's file."""
    second: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="B")]
    """The run that it is compared with."""


@dataclass(frozen=True, kw_only=True)
class SiteCommand(Command):
    """Options of `hab-eval site`."""

    help: ClassVar[str] = SITE_HELP
    work: ClassVar[str] = "hab_eval.commands.pages:build"

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="RUN...")] = ()
    """Runs of your own instead of submissions, with their videos and pages in 3-D (view_0.html):
    run folders (their --out)."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Output folder."""
    submissions: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder of submitted run.json files; this checkout's if not given."""
    videos: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder of recorded videos and pages in 3-D, with a folder per submission."""
    checkout: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Checkout with the datasets' figures (docs), model cards (baselines) and episode files
    (assets/episodes); this one if not given."""
    force: bool = False
    """Replace the site in DIR."""


@dataclass(frozen=True, kw_only=True)
class SubmitCommand(Command):
    """Options of `hab-eval submit`."""

    help: ClassVar[str] = SUBMIT_HELP
    work: ClassVar[str] = "hab_eval.commands.pages:submit"

    run_path: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """The run: its folder (the --out of hab-eval run) or its run.json."""
    submissions: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder of submissions; this checkout's if not given."""
    name: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """Name of the submission, instead of the above."""
    force: bool = False
    """Replace a submission of the same name."""


@dataclass(frozen=True, kw_only=True)
class RepeatCommand(Command):
    """Options of the commands that repeat an episode of a submission."""

    submission: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SUBMISSION")]
    """The submission: its name in the submissions folder, or a run (folder or run.json)."""
    submissions: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder of submissions; this checkout's if not given."""
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
    verbose: bool = False
    """Print the traceback of an error in an episode."""


@dataclass(frozen=True, kw_only=True)
class ReplayCommand(RepeatCommand):
    """Options of the commands that repeat several episodes."""

    episode: Annotated[
        tuple[int, ...], tyro.conf.arg(metavar="INDEX"), tyro.conf.UseAppendAction
    ] = ()
    """Index of an episode to repeat, from 0, instead of the command's own choice; can be
    repeated."""
    workers: Annotated[int, tyro.conf.arg(metavar="W")] = 1
    """Number of worker processes; does not change results."""


@dataclass(frozen=True, kw_only=True)
class ViewCommand(RepeatCommand):
    """Options of `hab-eval view`."""

    help: ClassVar[str] = VIEW_HELP
    work: ClassVar[str] = "hab_eval.commands.view:view"

    episode: Annotated[int, tyro.conf.arg(metavar="INDEX")]
    """Index of the episode, from 0."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Output: a page (.html), which works as a file, or a recording for viser's client (.viser).
    The page is served on the loopback interface if not given."""
    force: bool = False
    """Overwrite FILE."""


@dataclass(frozen=True, kw_only=True)
class VerifyCommand(ReplayCommand):
    """Options of `hab-eval verify`."""

    help: ClassVar[str] = VERIFY_HELP
    work: ClassVar[str] = "hab_eval.commands.replay:verify"

    episodes: Annotated[int, tyro.conf.arg(metavar="N")] = 10
    """Number of episodes to repeat, drawn at random."""
    sample_seed: Annotated[int, tyro.conf.arg(metavar="S")] = 0
    """Seed of the draw."""


@dataclass(frozen=True, kw_only=True)
class FilmCommand(ReplayCommand):
    """Options of `hab-eval film`."""

    help: ClassVar[str] = FILM_HELP
    work: ClassVar[str] = "hab_eval.commands.replay:film"

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Folder for the videos; they are written to a folder in it with the submission's name."""
    force: bool = False
    """Replace existing videos."""
