"""Benchmark reports: the rows of a suite, and a file of them with commit, date and machine."""

from __future__ import annotations

import datetime
import json
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.table import Table

from hab_eval.records import provenance
from hab_eval.records.plain_text import markdown
from hab_eval.records.schema import parse_json, read_dataclass
from hab_tasks.io.files import check_file, written_aside
from hab_tasks.typed_values import to_json

COMMIT_DIGITS = 12


@dataclass(frozen=True, kw_only=True)
class BenchReport:
    """What `hab-eval bench --json` writes.

    Attributes:
        suite: Name of the suite.
        git: Commit of the sources; None outside of a checkout.
        date: Day of the measurement, ISO 8601.
        device: Processor and graphics card.
        versions: Distribution -> version.
        rows: The measurements.
    """

    suite: str
    git: str | None
    date: str
    device: str
    versions: dict[str, str]
    rows: tuple[BenchRow, ...]


def make_report(suite: str, rows: Sequence[BenchRow]) -> BenchReport:
    """Returns the report of rows that were measured here, now."""
    return BenchReport(
        suite=suite,
        git=provenance.git_commit(),
        date=datetime.datetime.now(datetime.timezone.utc).date().isoformat(),
        device=provenance.device(),
        versions=provenance.package_versions("hab_eval"),
        rows=tuple(rows),
    )


def write_report(path: Path, report: BenchReport, *, force: bool) -> None:
    """Writes a report as JSON."""
    check_file(path, force=force)
    with written_aside(path) as scratch:
        scratch.write_text(json.dumps(to_json(report), indent=1) + "\n", encoding="utf-8")


def read_report(path: Path) -> BenchReport:
    """Reads a report.

    Raises:
        ResultError: The file is missing or is not a report.
    """
    return read_dataclass(BenchReport, parse_json(path), path.name)


def report_table(report: BenchReport, unit: str = "") -> str:
    """Returns the rows as a Markdown table, with commit, date, machine and references above it.

    Args:
        report: The report.
        unit: Unit of the rows to show; empty for all.
    """
    rows = [row for row in report.rows if unit in ("", row.unit)]
    references = ", ".join(dict.fromkeys(row.reference for row in rows))
    commit = (report.git or "unknown")[:COMMIT_DIGITS]
    caption = f"Commit {commit}, {report.date}, {report.device}. Reference: {references}."
    lines = [["", "here", "reference", "ratio", "unit"], ["---"] * 5]
    for row in rows:
        values = (row.value, row.reference_value, row.ratio)
        name = row.name.removeprefix(f"{report.suite}/")
        lines.append([name, *(_rounded(value) for value in values), row.unit])
    table = "\n".join(f"| {' | '.join(map(markdown, line))} |" for line in lines)
    return f"{markdown(caption)}\n\n{table}\n"


def _rounded(value: float) -> str:
    """Returns three significant digits, and all digits before the point."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


REFERENCE = "ManiSkill ReplicaCAD_SceneManipulation-v1 fetch pd_ee_delta_pos"


@dataclass(frozen=True, kw_only=True)
class BenchRow:
    """One value and its reference; `ratio` is `value / reference_value`.

    Attributes:
        name: ``suite/scene/env/variant``.
        value: Median of the measurements.
        unit: Unit of both values.
        reference: Name of the reference, or ``bound``.
        reference_value: Median of the reference, measured in the same run, or the fixed bound.
        n: Number of repeats.
    """

    name: str
    value: float
    unit: str
    reference: str
    reference_value: float
    ratio: float
    n: int


def make_row(
    name: Sequence[str],
    values: Sequence[float],
    reference_values: Sequence[float],
    *,
    unit: str,
    reference: str = REFERENCE,
) -> BenchRow:
    """Returns the row of alternating measurements; `name` is (suite, scene, env, variant)."""
    value, reference_value = statistics.median(values), statistics.median(reference_values)
    return BenchRow(
        name="/".join(name),
        value=value,
        unit=unit,
        reference=reference,
        reference_value=reference_value,
        ratio=value / reference_value,
        n=len(values),
    )


def bound_row(name: Sequence[str], values: Sequence[float], bound: float, *, unit: str) -> BenchRow:
    """Returns the row of measurements with a fixed bound."""
    return make_row(name, values, [bound], unit=unit, reference="bound")


def row_table(rows: Sequence[BenchRow]) -> Table:
    """Returns the rows as a table for the terminal."""
    table = Table()
    for column in ("name", "ours", "reference", "ratio", "unit", "n"):
        table.add_column(column, overflow="fold")  # names must not be truncated
    for row in rows:
        numbers = (row.value, row.reference_value, row.ratio)
        table.add_row(row.name, *(f"{value:.3f}" for value in numbers), row.unit, str(row.n))
    return table
