"""Results as tables for a terminal."""

from __future__ import annotations

from collections.abc import Iterable

from rich.table import Table

from hab_eval.leaderboard import Group
from hab_eval.results import RunRecord
from hab_eval.stats import Estimate


def result_table(record: RunRecord) -> Table:
    """Returns everything a user wants to know of one run."""
    summary = record.summary
    table = Table(title=f"{record.agent_name} on {record.env}, {record.scene_dataset}")
    table.add_column("measure")
    table.add_column("value")
    for name, value in record.options.items():
        table.add_row(f"option {name}", value)
    table.add_row("success", _percent(summary.success))
    for name, stage in summary.stages.items():
        table.add_row(f"stage {name}", _percent(stage))
    for name, count in summary.failures.items():
        table.add_row(f"failure: {name}", f"{count} of {summary.success.n}")
    mean_return = summary.mean_return
    low, high = mean_return.ci95
    table.add_row("return", f"{mean_return.mean:.3f} [{low:.3f}, {high:.3f}]")
    table.add_row("steps", f"{summary.mean_steps:.1f}")
    for name, duration in summary.timings_s.items():
        table.add_row(f"time: {name}", f"{duration.mean:.3f} s mean, {duration.max:.3f} s max")
    table.add_row("seconds per step", f"{summary.seconds_per_step:.4f}")
    return table


def leaderboard_tables(groups: Iterable[Group]) -> list[Table]:
    """Returns one table for each group of the leaderboard."""
    return [_group_table(group) for group in groups]


def _group_table(group: Group) -> Table:
    table = Table(title=group.title, caption=group.note or None)
    for column in group.columns:
        table.add_column(column, overflow="fold")
    for row in group.rows:
        table.add_row(*row)
    return table


def _percent(estimate: Estimate) -> str:
    low, high = (100.0 * bound for bound in estimate.ci95)
    return f"{100.0 * estimate.mean:.1f} % [{low:.1f}, {high:.1f}] of {estimate.n}"
