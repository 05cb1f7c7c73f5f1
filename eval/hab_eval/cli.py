"""The console script `hab-eval`."""

from __future__ import annotations

from collections.abc import Sequence

from hab_eval.commands.options import BenchCommand, RunCommand, ServeCommand, SweepCommand
from hab_eval.commands.record_options import (
    CompareCommand,
    FailuresCommand,
    FilmCommand,
    SiteCommand,
    SubmitCommand,
    TableCommand,
    VerifyCommand,
    ViewCommand,
)
from hab_tasks.io.console import Command, run_script

DESCRIPTION = "Evaluation, leaderboard, results site and benchmarks of hab-tasks."

COMMANDS: dict[str, type[Command]] = {
    "run": RunCommand,
    "sweep": SweepCommand,
    "serve": ServeCommand,
    "table": TableCommand,
    "failures": FailuresCommand,
    "compare": CompareCommand,
    "site": SiteCommand,
    "submit": SubmitCommand,
    "verify": VerifyCommand,
    "film": FilmCommand,
    "view": ViewCommand,
    "bench": BenchCommand,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs `hab-eval`; returns its exit status."""
    return run_script("hab-eval", COMMANDS, arguments, DESCRIPTION)
