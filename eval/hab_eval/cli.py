"""The console script `hab-eval`."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import tyro

from hab_eval.episode_options import EpisodeOptions
from hab_eval.errors import OptionError, RunStoppedError
from hab_tasks.errors import HabError
from hab_tasks.files import check_file, written_aside
from hab_tasks.options import one_line, parse_command

DESCRIPTION = "Evaluation, leaderboard and benchmarks of hab-tasks."

EXIT_BAD_INPUT = 2
EXIT_STOPPED = 1
EXIT_INTERRUPTED = 130

RUN_HELP = """Evaluates an agent on a fixed list of episodes and writes run.json.

Example:
  hab-eval run --agent hab_eval:random_agent --env HabPick-v1 --episodes 10 --out runs/random

The same command with --resume goes on after an interruption."""

TABLE_HELP = """Writes LEADERBOARD.md and its web page from the submissions.

Example:
  hab-eval table --submissions eval/leaderboard/submissions --out eval/leaderboard/LEADERBOARD.md

With --check nothing is written, and the exit status tells whether the files are up to date."""

FAILURES_HELP = """Shows why episodes failed, for one or several runs: a table, and a figure.

Example:
  hab-eval failures runs/tidy_house runs/set_table/run.json --out failures.png"""

BENCH_HELP = """Measures speed and memory, side by side with ManiSkill's own scene environment.

Example:
  hab-eval bench --suite sim --scene-dataset ~/data/replica_cad --json bench_sim.json

Needs the real ReplicaCAD: what is compared runs in the same scenes, alternately, in this command.

Suites:
  sim        steps on state observations, beside ManiSkill's own environment
  depth      steps with two depth cameras, beside the same
  reset      resets within and between layouts, beside the same
  objects    time outside the physics engine with 10, 30 and 100 objects in the scene
  processes  steps of two processes, beside one
  memory     memory of one process, and what each further one adds
  plan       arm plans of the baseline SPA, which has to be installed"""


@dataclass(frozen=True, kw_only=True)
class RunCommand(EpisodeOptions):
    """Options of `hab-eval run`."""

    help: ClassVar[str] = RUN_HELP

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Folder for run.json, episodes.jsonl, config.json and videos."""
    episodes: Annotated[int, tyro.conf.arg(metavar="N")] = 50
    """Number of episodes."""
    workers: Annotated[int, tyro.conf.arg(metavar="W")] = 1
    """Number of processes; changes no result. An agent that acts on several rows runs once, and the
    processes hold the environments of its rows."""
    step_timeout: Annotated[float | None, tyro.conf.arg(metavar="SECONDS")] = None
    """Longest time for one call of the agent's act, reset or report; the episode of a longer one
    has failed (`agent timeout`), its process is replaced, and the run goes on. Without it, as long
    as it takes."""
    device: Annotated[str, tyro.conf.arg(metavar="NAME")] = "cpu"
    """Where the agent's networks run, e.g. cuda."""
    video: Annotated[int, tyro.conf.arg(metavar="K")] = 0
    """Film the first K episodes; needs a Vulkan device, software ones included."""
    resume: bool = False
    """Go on with the run in --out."""
    force: bool = False
    """Replace the run in --out."""
    verbose: bool = False
    """Print a line for each episode, also above a progress bar."""


@dataclass(frozen=True, kw_only=True)
class TableCommand:
    """Options of `hab-eval table`."""

    help: ClassVar[str] = TABLE_HELP

    submissions: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder of submitted run.json files, instead of the checkout's own."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Markdown file, instead of LEADERBOARD.md beside the submissions; the page ends in .html."""
    check: bool = False
    """Only compare; exit status 1 if a file is out of date."""


@dataclass(frozen=True, kw_only=True)
class FailuresCommand:
    """Options of `hab-eval failures`."""

    help: ClassVar[str] = FAILURES_HELP

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="RUN...")]
    """Runs to compare: folders of --out, or run.json files."""
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """Picture, a .png."""
    force: bool = False
    """Replace FILE."""


@dataclass(frozen=True, kw_only=True)
class BenchCommand:
    """Options of `hab-eval bench`."""

    help: ClassVar[str] = BENCH_HELP

    suite: Literal["sim", "depth", "reset", "objects", "processes", "memory", "plan"]
    """What to measure."""
    json: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """File for the rows."""
    scene_dataset: Annotated[Path, tyro.conf.arg(metavar="PATH")]
    """The real ReplicaCAD folder; it is only read."""
    objects: Annotated[Path | None, tyro.conf.arg(metavar="PATH")] = None
    """A YCB folder, instead of the shipped objects."""
    scene: Annotated[tuple[str, ...], tyro.conf.arg(metavar="ID"), tyro.conf.UseAppendAction] = ()
    """A scene, instead of the suite's own; may be given again."""
    env: Annotated[tuple[str, ...], tyro.conf.arg(metavar="ID"), tyro.conf.UseAppendAction] = ()
    """Suite sim: an environment, instead of all in the first scene and HabPick-v1 in the others;
    may be given again."""
    repeats: Annotated[int, tyro.conf.arg(metavar="N")] = 5
    """Alternations of ours and the reference; the median of each is reported."""
    steps: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Steps of one repeat, or plans in suite plan, instead of the suite's own."""
    force: bool = False
    """Replace FILE."""


AnyCommand = RunCommand | TableCommand | FailuresCommand | BenchCommand

COMMANDS: dict[str, Any] = {
    "run": RunCommand,
    "table": TableCommand,
    "failures": FailuresCommand,
    "bench": BenchCommand,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs `hab-eval`; returns its exit status."""
    arguments = sys.argv[1:] if arguments is None else arguments
    signal.signal(signal.SIGTERM, _interrupt)  # a cluster's way to say Ctrl-C
    out: Path | None = None
    try:
        command: AnyCommand = parse_command("hab-eval", COMMANDS, arguments, DESCRIPTION)
        out = command.out if isinstance(command, RunCommand) else None
        return _dispatch(command)
    except HabError as error:
        print(f"hab-eval: {one_line(error)}", file=sys.stderr)
        return EXIT_STOPPED if isinstance(error, RunStoppedError) else EXIT_BAD_INPUT
    except OSError as error:  # of stdout, or of a disk
        print(f"hab-eval: {one_line(error)}", file=sys.stderr)
        return EXIT_STOPPED
    except KeyboardInterrupt:
        print(f"hab-eval: interrupted.{_advice(out)}", file=sys.stderr)
        return EXIT_INTERRUPTED


def _dispatch(command: AnyCommand) -> int:
    if isinstance(command, RunCommand):
        return _run(command)
    if isinstance(command, TableCommand):
        return _table(command)
    if isinstance(command, FailuresCommand):
        return _failures(command)
    return _bench(command)


def _run(command: RunCommand) -> int:
    """Evaluates, then shows the result and where it stands."""
    from hab_eval.evaluate import RunOptions, evaluate
    from hab_eval.leaderboard import (
        build_groups,
        default_submissions,
        group_title,
        read_submissions,
    )
    from hab_eval.plain_text import show
    from hab_eval.progress import make_reporter
    from hab_eval.report import leaderboard_tables, result_table

    options = RunOptions(
        out=command.out,
        workers=command.workers,
        videos=command.video,
        resume=command.resume,
        force=command.force,
        device=command.device,
    )
    reporter = make_reporter(
        terminal=sys.stderr.isatty(),
        verbose=command.verbose,
        write_line=lambda line: print(line, flush=True),
    )
    record = evaluate(command.config_of(command.episodes, command.step_timeout), options, reporter)
    show(result_table(record))
    print(f"wrote {command.out / 'run.json'}")
    folder = default_submissions()
    others = read_submissions(folder) if folder.is_dir() else {}
    groups = build_groups({**others, "this run": record})
    for table in leaderboard_tables([g for g in groups if g.title == group_title(record)]):
        show(table)
    return 0


def _table(command: TableCommand) -> int:
    """Writes or checks the leaderboard."""
    from hab_eval.leaderboard import (
        build_groups,
        default_submissions,
        read_submissions,
        to_html,
        to_markdown,
    )

    submissions = command.submissions or default_submissions()
    target = command.out or submissions.parent / "LEADERBOARD.md"
    groups = build_groups(read_submissions(submissions))
    if not target.name:
        raise OptionError(f"--out {target} is a folder; give the name of a file.")
    page = target.with_name(f"{target.stem}.html")
    texts = {target: to_markdown(groups), page: to_html(groups)}
    if page == target:
        raise OptionError(f"--out {target} is the name of the web page; give one that ends in .md.")
    for path in () if command.check else texts:
        check_file(path, force=True)  # both or none
    for path, text in texts.items():
        if not command.check:
            with written_aside(path) as scratch:
                scratch.write_text(text, encoding="utf-8")
            print(f"wrote {path}")
        elif not os.path.isfile(path) or path.read_bytes() != text.encode("utf-8"):
            print(f"hab-eval: {path} is out of date; run hab-eval table.", file=sys.stderr)
            return EXIT_STOPPED
    return 0


def _failures(command: FailuresCommand) -> int:
    """Shows and draws why episodes failed."""
    from hab_eval.failures import check_picture, draw_failures, failure_table, read_runs
    from hab_eval.plain_text import show

    check_picture(command.out, force=command.force)
    records = read_runs(command.runs)
    draw_failures(records, command.out)
    show(failure_table(records))
    print(f"wrote {command.out}")
    return 0


def _bench(command: BenchCommand) -> int:
    """Measures, then shows and writes the rows."""
    from hab_eval.bench import run_suite
    from hab_eval.bench_options import BenchOptions
    from hab_eval.bench_rows import check_target, row_table, write_rows
    from hab_eval.plain_text import show

    options = BenchOptions(
        suite=command.suite,
        scene_dataset=command.scene_dataset,
        objects=command.objects,
        scenes=command.scene,
        envs=command.env,
        repeats=command.repeats,
        steps=command.steps,
    )
    check_target(command.json, force=command.force)  # before minutes are spent
    rows = run_suite(options, lambda line: print(line, flush=True))
    write_rows(command.json, rows, force=command.force)
    show(row_table(rows))
    print(f"wrote {command.json}")
    return 0


def _interrupt(signal_number: int, frame: object) -> None:
    raise KeyboardInterrupt


def _advice(out: Path | None) -> str:
    """Tells how an interrupted run goes on."""
    return f" Finished episodes are kept in {out}; go on with --resume." if out else ""
