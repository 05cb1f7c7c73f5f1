"""Benchmark results: each value with its reference or bound."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass

from rich.table import Table

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
