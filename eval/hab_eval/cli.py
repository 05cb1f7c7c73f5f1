"""The console script `hab-eval`."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from hab_eval.episode_options import EpisodeOptions
from hab_eval.site.cli import SiteCommand
from hab_eval.submissions.cli import FilmCommand, SubmitCommand, VerifyCommand
from hab_tasks.console import Command, run_script
from hab_tasks.errors import OptionError
from hab_tasks.executors import ExecutorChoice
from hab_tasks.files import check_file, written_aside

DESCRIPTION = "Evaluation, leaderboard, results site and benchmarks of hab-tasks."

EXIT_OUT_OF_DATE = 1

RUN_HELP = """Evaluates an agent on a fixed set of episodes and writes run.json.

Example:
  hab-eval run --agent hab_eval:random_agent --env HabPick-v1 --episodes 10 --out runs/random

After an interruption, the same command with --resume continues the run.

On a Ray cluster (pip install 'ray>=2.30'), from one of its nodes:
  hab-eval run --agent hab_eval:random_agent --env HabPick-v1 --episodes 1000 --workers 64 \\
    --executor ray --address auto --out runs/random

Episodes of a node that dies are played again on the others."""

TABLE_HELP = """Generates LEADERBOARD.md and its web page from the submissions.

Example:
  hab-eval table --pages README.md

Tables within a page stand between <!-- results: AGENT --> and <!-- end of results -->. With
--check, nothing is written; the exit status says whether the files are up to date."""

FAILURES_HELP = """Breaks down the failures of one or several runs by category (table and figure).

Example:
  hab-eval failures runs/tidy_house runs/set_table/run.json --out failures.png"""

BENCH_HELP = """Benchmarks speed and memory against ManiSkill's own scene environment.

Example:
  hab-eval bench --suite sim --scene-dataset ~/data/replica_cad --json bench_sim.json

Requires the real ReplicaCAD. Both environments run in the same scenes, alternating.

Suites:
  sim        steps/s with state observations, compared with ManiSkill
  depth      steps/s with two depth cameras, compared with ManiSkill
  reset      reset time within and between layouts, compared with ManiSkill
  objects    time outside the physics engine with 10, 30 and 100 objects in the scene
  processes  steps/s of two processes, compared with one
  memory     memory of one process and of each additional one
  vector     steps/s of 16 rows of the vector environment, compared with AsyncVectorEnv
  rays       depth images computed on the CPU, compared with a software renderer
  episodes   time per generated episode
  plan       arm planning time of the SPA baseline, which must be installed
  train      training steps of hab-ppo, which must be installed"""


@dataclass(frozen=True, kw_only=True)
class RunCommand(EpisodeOptions, ExecutorChoice, Command):
    """Options of `hab-eval run`."""

    help: ClassVar[str] = RUN_HELP

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Output folder for run.json, episodes.jsonl, config.json and videos."""
    episodes: Annotated[int, tyro.conf.arg(metavar="N")] = 50
    """Number of episodes."""
    workers: Annotated[int, tyro.conf.arg(metavar="W")] = 1
    """Number of worker processes; does not change results. A batched agent runs once, in the main
    process; the workers then only step its environments."""
    step_timeout: Annotated[float | None, tyro.conf.arg(metavar="SECONDS")] = None
    """Time limit for one call of the agent's act, reset or report; no limit if not given. An
    episode that exceeds it fails (`agent timeout`), its process is replaced, and the run
    continues."""
    isolated: bool = False
    """Run the agent in a process without environment, which knows neither the seed nor the
    episodes; the leaderboard says so. Outcomes stay the same."""
    device: Annotated[str, tyro.conf.arg(metavar="NAME")] = "cpu"
    """Device of the agent's networks, e.g. cuda."""
    video: Annotated[int, tyro.conf.arg(metavar="K")] = 0
    """Record videos of the first K episodes; needs a Vulkan device (software is enough)."""
    resume: bool = False
    """Continue the run in --out."""
    force: bool = False
    """Replace the run in --out."""
    verbose: bool = False
    """Print a line for each episode, even with a progress bar, and the traceback of an error in an
    episode."""

    def run(self) -> int:
        """Evaluates the agent, then prints the results and its rank on the leaderboard."""
        from hab_eval.evaluate import RunOptions, evaluate
        from hab_eval.leaderboard import (
            build_groups,
            default_submissions,
            find_submissions,
            group_title,
        )
        from hab_eval.plain_text import show
        from hab_eval.progress import make_reporter
        from hab_eval.report import leaderboard_tables, result_table

        options = RunOptions(
            out=self.out.absolute(),  # an agent may change the working directory
            workers=self.workers,
            executor=ExecutorChoice(executor=self.executor, address=self.address),
            videos=self.video,
            resume=self.resume,
            force=self.force,
            device=self.device,
        )
        reporter = make_reporter(
            terminal=sys.stderr.isatty(),
            verbose=self.verbose,
            write_line=lambda line: print(line, flush=True),
        )
        config = self.config_of(self.episodes, self.step_timeout, isolated=self.isolated)
        record = evaluate(config, options, reporter)
        show(result_table(record))
        print(f"wrote {self.out / 'run.json'}")
        folder = default_submissions()
        others = find_submissions(folder, record.env).current if folder.is_dir() else {}
        groups = build_groups({**others, "this run": record})
        for table in leaderboard_tables([g for g in groups if g.title == group_title(record)]):
            show(table)
        return 0

    def advice(self) -> str:
        """Returns how to continue an interrupted run."""
        return f"Finished episodes are kept in {self.out}; continue with --resume."


@dataclass(frozen=True, kw_only=True)
class TableCommand(Command):
    """Options of `hab-eval table`."""

    help: ClassVar[str] = TABLE_HELP

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

    def run(self) -> int:
        """Writes or checks the leaderboard."""
        from hab_eval.leaderboard import default_submissions, find_submissions, leaderboard_texts
        from hab_eval.result_tables import filled

        submissions = self.submissions or default_submissions()
        benchmarks = self.benchmarks or submissions.parent.parent / "benchmarks"
        target = self.out or submissions.parent / "LEADERBOARD.md"
        found = find_submissions(submissions)
        if not target.name:
            raise OptionError(f"--out {target} is a folder; give a file name.")
        if target.suffix == ".html":
            raise OptionError(
                f"--out {target} is the name of the web page; give a name that ends in .md."
            )
        texts = leaderboard_texts(found, target)
        for path in self.pages:
            link = os.path.relpath(target, path.parent)
            texts[path] = filled(_text_of(path), found, benchmarks, link)
        for path in () if self.check else texts:
            check_file(path, force=True)  # both or none
        for path, text in texts.items():
            if not self.check:
                with written_aside(path) as scratch:
                    scratch.write_text(text, encoding="utf-8")
                print(f"wrote {path}")
            elif not os.path.isfile(path) or path.read_bytes() != text.encode("utf-8"):
                print(f"hab-eval: {path} is out of date; run hab-eval table.", file=sys.stderr)
                return EXIT_OUT_OF_DATE
        return 0


def _text_of(page: Path) -> str:
    try:
        return page.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise OptionError(f"--pages {page}: cannot be read ({error}).") from error


@dataclass(frozen=True, kw_only=True)
class FailuresCommand(Command):
    """Options of `hab-eval failures`."""

    help: ClassVar[str] = FAILURES_HELP

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="RUN...")]
    """Runs to compare: run folders (their --out) or run.json files."""
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """Output figure, a .png file."""
    force: bool = False
    """Overwrite FILE."""

    def run(self) -> int:
        """Prints and plots the failure categories."""
        from hab_eval.failures import check_picture, draw_failures, failure_table, read_runs
        from hab_eval.plain_text import show

        check_picture(self.out, force=self.force)
        records = read_runs(self.runs)
        draw_failures(records, self.out)
        show(failure_table(records))
        print(f"wrote {self.out}")
        return 0


@dataclass(frozen=True, kw_only=True)
class BenchCommand(Command):
    """Options of `hab-eval bench`."""

    help: ClassVar[str] = BENCH_HELP

    suite: Annotated[str, tyro.conf.arg(metavar="NAME")]
    """Benchmark suite, see above."""
    json: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """Output file."""
    scene_dataset: Annotated[Path, tyro.conf.arg(metavar="PATH")]
    """Folder of the real ReplicaCAD dataset; it is not modified."""
    objects: Annotated[Path | None, tyro.conf.arg(metavar="PATH")] = None
    """Folder of the YCB dataset; the shipped objects if not given."""
    scene: Annotated[tuple[str, ...], tyro.conf.arg(metavar="ID"), tyro.conf.UseAppendAction] = ()
    """A scene; can be repeated. The scenes of the suite if not given."""
    env: Annotated[tuple[str, ...], tyro.conf.arg(metavar="ID"), tyro.conf.UseAppendAction] = ()
    """Suite sim: an environment; can be repeated. All environments in the first scene and
    HabPick-v1 in the others if not given."""
    repeats: Annotated[int, tyro.conf.arg(metavar="N")] = 5
    """Number of repeats, alternating with the reference; medians are reported."""
    steps: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Steps per repeat (suite plan: plans per repeat); the suite's number if not given."""
    force: bool = False
    """Overwrite FILE."""

    def run(self) -> int:
        """Runs the suite, then prints and writes the results."""
        from hab_eval.bench.options import BenchOptions
        from hab_eval.bench.report import make_report, write_report
        from hab_eval.bench.rows import row_table
        from hab_eval.bench.suites import find_suite, run_suite
        from hab_eval.plain_text import show

        options = BenchOptions(
            suite=find_suite(self.suite),
            scene_dataset=self.scene_dataset,
            objects=self.objects,
            scenes=self.scene,
            envs=self.env,
            repeats=self.repeats,
            steps=self.steps,
        )
        check_file(self.json, force=self.force)  # before minutes are spent
        rows = run_suite(options, lambda line: print(line, flush=True))
        write_report(self.json, make_report(self.suite, rows), force=self.force)
        show(row_table(rows))
        print(f"wrote {self.json}")
        return 0


COMMANDS: dict[str, type[Command]] = {
    "run": RunCommand,
    "table": TableCommand,
    "failures": FailuresCommand,
    "site": SiteCommand,
    "submit": SubmitCommand,
    "verify": VerifyCommand,
    "film": FilmCommand,
    "bench": BenchCommand,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs `hab-eval`; returns its exit status."""
    return run_script("hab-eval", COMMANDS, arguments, DESCRIPTION)
