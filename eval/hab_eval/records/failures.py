"""Failure analysis of one or several runs: a table, and a figure like the paper's Fig. 25."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import cycle
from pathlib import Path

from matplotlib.axes import Axes
from rich.table import Table

from hab_eval.records.leaderboard import agent_label, group_title
from hab_eval.records.plain_text import add_row, figure_text, plain
from hab_eval.records.results import RunRecord
from hab_tasks.errors import OptionError
from hab_tasks.figure_style import (
    BLUE,
    EDGE,
    GREEN,
    ORANGE,
    VERMILION,
    bare,
    new_figure,
    save,
)
from hab_tasks.io.files import check_file

PLANNING = ("target plan", "motion plan", "execution")
"""Categories of the paper (S App. I.1, Fig. 25); shown first."""

PANEL_HEIGHT_IN = 2.4
CATEGORY_WIDTH_IN = 0.5
BAR_WIDTH_IN = 0.42


def check_picture(out: Path, *, force: bool) -> None:
    """Checks that the figure is a .png file that may be written."""
    if out.suffix != ".png":
        raise OptionError(f"--out {out} must end in .png.")
    check_file(out, force=force)


def categories(records: Sequence[RunRecord]) -> tuple[str, ...]:
    """Returns the categories to show: those of planning, if any occurs, then by frequency."""
    counts = Counter[str]()
    for record in records:
        counts.update(record.summary.failures)
    planning = PLANNING if not counts or counts.keys() & set(PLANNING) else ()
    others = sorted(counts.keys() - set(PLANNING), key=lambda name: (-counts[name], name))
    return (*planning, *others)


def percent(record: RunRecord, category: str) -> float:
    """Returns the percentage of a run's episodes in a failure category."""
    return 100.0 * record.summary.failures.get(category, 0) / record.summary.success.n


def failure_table(records: Sequence[RunRecord]) -> Table:
    """Returns the failure percentages, one row per run."""
    shown = categories(records)
    table = Table(title="Failures [% of episodes]")
    for column in ("run", "on", "n", "success", *shown):
        table.add_column(plain(column), overflow="fold")
    for label, record in zip(_labels(records), records, strict=True):
        success = record.summary.success
        shares = [f"{percent(record, name):.1f}" for name in shown]
        mean = f"{100.0 * success.mean:.1f}"
        add_row(table, label, group_title(record), str(success.n), mean, *shares)
    return table


def draw_failures(records: Sequence[RunRecord], out: Path) -> None:
    """Plots the failure percentages: one panel per environment and dataset, one bar per run."""
    shown, labels = categories(records), _labels(records)
    panels: dict[str, list[int]] = {}
    for number, record in enumerate(records):
        panels.setdefault(group_title(record), []).append(number)
    most = max(len(numbers) for numbers in panels.values())
    width_in = 1.2 + len(shown) * (CATEGORY_WIDTH_IN + most * BAR_WIDTH_IN)
    figure = new_figure(max(width_in, 5.0), 0.4 + PANEL_HEIGHT_IN * len(panels))
    axes = figure.subplots(len(panels), 1, squeeze=False, sharey=True)[:, 0]
    for panel, (title, numbers) in zip(axes, panels.items(), strict=True):
        _draw_panel(panel, [records[i] for i in numbers], [labels[i] for i in numbers], shown)
        panel.set_title(figure_text(title), fontsize=10, loc="left")
    highest = max(percent(record, name) for record in records for name in shown)
    axes[0].set_ylim(0.0, 1.15 * max(highest, 5.0))
    save(figure, out)


def _draw_panel(
    axes: Axes, records: Sequence[RunRecord], labels: Sequence[str], shown: Sequence[str]
) -> None:
    looks = cycle(zip((BLUE, ORANGE, GREEN, VERMILION), ("", "//", "..", "\\\\"), strict=True))
    width = 0.8 / len(records)
    for number, (record, label) in enumerate(zip(records, labels, strict=True)):
        colour, hatch = next(looks)
        at = [index + width * (number - (len(records) - 1) / 2) for index in range(len(shown))]
        values = [percent(record, name) for name in shown]
        drawn = axes.bar(
            at,
            values,
            0.92 * width,
            color=colour,
            hatch=hatch,
            edgecolor=EDGE,
            label=figure_text(label),
        )
        axes.bar_label(drawn, [f"{value:.3g}" for value in values], fontsize=8, padding=1)
    axes.set_xticks(
        range(len(shown)), [figure_text(name.replace("_", " ")) for name in shown], fontsize=8.5
    )
    axes.set_ylabel("% of episodes", fontsize=9)
    axes.legend(fontsize=8, frameon=False)
    bare(axes)
    axes.tick_params(axis="x", labelsize=8.5)


def _labels(records: Sequence[RunRecord]) -> list[str]:
    """Returns distinct run names: agent and options, plus seed and number where needed."""
    plain = [agent_label(record) for record in records]
    seeded = [
        name if _alone(record, name, records, plain) else f"{name}, seed {record.seed}"
        for record, name in zip(records, plain, strict=True)
    ]
    return [
        name if _alone(record, name, records, seeded) else f"{name} [{number}]"
        for number, (record, name) in enumerate(zip(records, seeded, strict=True), start=1)
    ]


def _alone(
    record: RunRecord, name: str, records: Sequence[RunRecord], names: Sequence[str]
) -> bool:
    """Returns whether a run's name is unique on its environment and dataset."""
    named = zip(records, names, strict=True)
    return sum(group_title(r) == group_title(record) and n == name for r, n in named) == 1
