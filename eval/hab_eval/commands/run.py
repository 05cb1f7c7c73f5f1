"""The work of `hab-eval run`, and its tables."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import replace

from rich.table import Table

from hab_eval.commands.options import RunCommand
from hab_eval.records.config import EvalConfig
from hab_eval.records.leaderboard import (
    Group,
    build_groups,
    default_submissions,
    group_title,
    read_submissions,
)
from hab_eval.records.plain_text import add_row, plain, show
from hab_eval.records.results import RunRecord
from hab_eval.records.stats import Estimate
from hab_eval.run.evaluate import RunOptions, evaluate
from hab_eval.run.progress import make_reporter
from hab_tasks.io.executors import ExecutorChoice
from hab_tasks.registration import TASKS

ALL_TASKS = "tasks"
"""Instead of an environment id: all tasks, each in a folder of its own."""


def run(options: RunCommand) -> int:
    """Evaluates the agent, in one environment or in all tasks."""
    if options.env != ALL_TASKS:
        return run_one(options)
    for env_id in TASKS:
        out = options.out / env_id
        # A task after an interrupted one has no folder yet.
        resume = options.resume and out.exists()
        run_one(replace(options, env=env_id, out=out, resume=resume))
    return 0


def evaluated(options: RunCommand, config: EvalConfig) -> RunRecord:
    """Evaluates the agent as configured, with the output and processes of `options`."""
    run_options = RunOptions(
        out=options.out.absolute(),  # an agent may change the working directory
        workers=options.workers,
        executor=ExecutorChoice(executor=options.executor, address=options.address),
        videos=options.video,
        resume=options.resume,
        force=options.force,
        device=options.device,
    )
    reporter = make_reporter(
        terminal=sys.stderr.isatty(),
        verbose=options.verbose,
        write_line=lambda line: print(line, flush=True),
    )
    return evaluate(config, run_options, reporter)


def run_one(options: RunCommand) -> int:
    """Evaluates the agent, then prints the results and its rank on the leaderboard."""
    record = evaluated(options, options.config_of_run())
    show(result_table(record))
    print(f"wrote {options.out / 'run.json'}")
    folder = default_submissions()
    others = read_submissions(folder, record.env) if folder.is_dir() else {}
    groups = build_groups({**others, "this run": record})
    for table in leaderboard_tables([g for g in groups if g.title == group_title(record)]):
        show(table)
    return 0


def result_table(record: RunRecord) -> Table:
    """Returns the summary of one run."""
    summary = record.summary
    table = Table(title=plain(f"{record.agent_name} on {record.env}, {record.scene_dataset}"))
    table.add_column("measure")
    table.add_column("value")
    for name, value in record.options.items():
        add_row(table, f"option {name}", value)
    add_row(table, "success", _percent(summary.success))
    for name, stage in summary.stages.items():
        add_row(table, f"stage {name}", _percent(stage))
    for name, score in summary.scores.items():
        add_row(table, name.upper(), _percent(score))
    for name, count in summary.failures.items():
        add_row(table, f"failure: {name}", f"{count} of {summary.success.n}")
    mean_return = summary.mean_return
    low, high = mean_return.ci95
    add_row(table, "return", f"{mean_return.mean:.3f} [{low:.3f}, {high:.3f}]")
    add_row(table, "steps", f"{summary.mean_steps:.1f}")
    for name, duration in summary.timings_s.items():
        add_row(table, f"time: {name}", f"{duration.mean:.3f} s mean, {duration.max:.3f} s max")
    add_row(table, "seconds per step", f"{summary.seconds_per_step:.4f}")
    return table


def leaderboard_tables(groups: Iterable[Group]) -> list[Table]:
    """Returns one table per group of the leaderboard."""
    return [_group_table(group) for group in groups]


def _group_table(group: Group) -> Table:
    table = Table(title=plain(group.title), caption=plain(group.note) or None)
    for column in group.columns:
        table.add_column(column, overflow="fold")
    for row in group.rows:
        add_row(table, *row)
    return table


def _percent(estimate: Estimate) -> str:
    low, high = (100.0 * bound for bound in estimate.ci95)
    return f"{100.0 * estimate.mean:.1f} % [{low:.1f}, {high:.1f}] of {estimate.n}"
