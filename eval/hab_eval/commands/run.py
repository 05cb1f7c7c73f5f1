"""The work of `hab-eval run`."""

from __future__ import annotations

import sys

from hab_eval.commands.options import RunCommand
from hab_eval.records.leaderboard import (
    build_groups,
    default_submissions,
    find_submissions,
    group_title,
)
from hab_eval.records.plain_text import show
from hab_eval.records.report import leaderboard_tables, result_table
from hab_eval.run.evaluate import RunOptions, evaluate
from hab_eval.run.progress import make_reporter
from hab_tasks.io.executors import ExecutorChoice


def run(options: RunCommand) -> int:
    """Evaluates the agent, then prints the results and its rank on the leaderboard."""
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
    config = options.config_of(options.episodes, options.step_timeout, isolated=options.isolated)
    record = evaluate(config, run_options, reporter)
    show(result_table(record))
    print(f"wrote {options.out / 'run.json'}")
    folder = default_submissions()
    others = find_submissions(folder, record.env).current if folder.is_dir() else {}
    groups = build_groups({**others, "this run": record})
    for table in leaderboard_tables([g for g in groups if g.title == group_title(record)]):
        show(table)
    return 0
