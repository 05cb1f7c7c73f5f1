"""The work of `hab-eval failures`."""

from __future__ import annotations

from hab_eval.commands.record_options import FailuresCommand
from hab_eval.records.failures import check_picture, draw_failures, failure_table
from hab_eval.records.plain_text import show
from hab_eval.records.results import read_runs


def show_failures(options: FailuresCommand) -> int:
    """Prints and plots the failure categories."""
    check_picture(options.out, force=options.force)
    records = read_runs(options.runs)
    draw_failures(records, options.out)
    show(failure_table(records))
    print(f"wrote {options.out}")
    return 0
