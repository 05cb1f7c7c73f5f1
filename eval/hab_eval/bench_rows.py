"""The rows of a benchmark: each figure beside its reference, or beside a bound."""

from __future__ import annotations

import json
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.table import Table

from hab_eval.schema import to_json
from hab_tasks.files import check_file, written_aside

REFERENCE = "ManiSkill ReplicaCAD_SceneManipulation-v1 fetch pd_ee_delta_pos"


@dataclass(frozen=True, kw_only=True)
class BenchRow:
    """One figure beside its reference; `ratio` is `value / reference_value`.

    Attributes:
        name: ``suite/scene/env/variant``.
        value: Median of ours.
        unit: Unit of both values.
        reference: What ours is compared with.
        reference_value: Median of the reference, measured in the same run; a bound is fixed.
        n: Repeats behind each median.
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
    ours: Sequence[float],
    theirs: Sequence[float],
    *,
    unit: str,
    reference: str = REFERENCE,
) -> BenchRow:
    """Returns the row of alternating measurements: suite, scene, env and variant make its name."""
    value, reference_value = statistics.median(ours), statistics.median(theirs)
    return BenchRow(
        name="/".join(name),
        value=value,
        unit=unit,
        reference=reference,
        reference_value=reference_value,
        ratio=value / reference_value,
        n=len(ours),
    )


def bound_row(name: Sequence[str], ours: Sequence[float], bound: float, *, unit: str) -> BenchRow:
    """Returns the row of measurements beside a fixed bound."""
    return make_row(name, ours, [bound], unit=unit, reference="bound")


def write_rows(path: Path, rows: Sequence[BenchRow], *, force: bool) -> None:
    """Writes the rows as JSON."""
    check_target(path, force=force)
    with written_aside(path) as scratch:
        scratch.write_text(json.dumps(to_json(list(rows)), indent=1) + "\n", encoding="utf-8")


def check_target(path: Path, *, force: bool) -> None:
    """Refuses to overwrite a result, and what cannot be written."""
    check_file(path, force=force)


def row_table(rows: Sequence[BenchRow]) -> Table:
    """Returns the rows as a table for a terminal."""
    table = Table()
    for column in ("name", "ours", "reference", "ratio", "unit", "n"):
        table.add_column(column, overflow="fold")  # a name cut short names nothing
    for row in rows:
        values = (row.value, row.reference_value, row.ratio)
        table.add_row(row.name, *(f"{value:.3f}" for value in values), row.unit, str(row.n))
    return table
