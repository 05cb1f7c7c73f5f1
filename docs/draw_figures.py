"""Draws the figures of speed from the benchmark reports; run it without arguments."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

DOCS = Path(__file__).resolve().parent
REPORTS = DOCS.parent / "eval" / "benchmarks"

SCENE = "v3_sc0_staging_00"
RATIOS = (
    ("vector", f"{SCENE}/HabPick-v1/16_rows", "16 rows / two in an AsyncVectorEnv"),
    ("vector", f"{SCENE}/HabPick-v1/16_rows_and_two_processes", "16 rows / two processes"),
    ("vector", f"{SCENE}/HabPick-v1/16_rows_and_maniskill", "16 rows / ManiSkill, AsyncVectorEnv"),
    ("sim", f"{SCENE}/HabPick-v1/ee", "one environment / ManiSkill"),
    ("rays", f"{SCENE}/HabPick-v1/two_cameras", "two depth cameras / ManiSkill"),
)
"""Report, row, and label of each bar of `speed_ratios.svg`."""

ENVS = ("HabPick-v1", "HabNavigate-v1", "HabTidyHouse-v1")

WIDTH, LABEL, BAR, ROW = 740, 300, 22, 34
INK, GRID, HERE, ENGINE = "#333333", "#d0d0d0", "#00796b", "#b0bec5"


@dataclass(frozen=True, kw_only=True)
class Part:
    """A coloured part of a bar."""

    value: float
    colour: str


@dataclass(frozen=True, kw_only=True)
class Bar:
    """A row of a chart: label, parts from left to right, and text at their end."""

    label: str
    parts: tuple[Part, ...]
    text: str


def figures() -> dict[str, str]:
    """Returns file name -> figure as SVG."""
    return {"speed_ratios.svg": _ratios(), "speed_time.svg": _times()}


def _ratios() -> str:
    bars = []
    for report, name, label in RATIOS:
        ratio = _row(report, name)["ratio"]
        part = Part(value=ratio, colour=HERE)
        bars.append(Bar(label=label, parts=(part,), text=f"{ratio:.1f} x"))
    return _chart("Steps per second, as a multiple of the reference (HabPick-v1)", bars, ())


def _times() -> str:
    bars = []
    for env in ENVS:
        row = _row("vector", f"{SCENE}/{env}/16_rows_outside_physics")
        engine, outside = row["reference_value"], row["value"]
        parts = (Part(value=engine, colour=ENGINE), Part(value=outside, colour=HERE))
        bars.append(Bar(label=env, parts=parts, text=f"{engine:.2f} + {outside:.2f} ms"))
    legend = (("physics engine", ENGINE), ("everything else", HERE))
    return _chart("Time of a step of one row, 16 rows in two workers", bars, legend)


def _row(report: str, name: str) -> dict[str, float]:
    """Returns a row of a report by name."""
    rows = json.loads((REPORTS / f"{report}.json").read_text(encoding="utf-8"))["rows"]
    (found,) = (row for row in rows if row["name"].removeprefix(f"{report}/") == name)
    return found


def _chart(title: str, bars: Sequence[Bar], legend: Sequence[tuple[str, str]]) -> str:
    """Returns a chart of horizontal bars."""
    top = 44 + (26 if legend else 0)
    height = top + ROW * len(bars) + 10
    scale = (WIDTH - LABEL - 120) / max(sum(p.value for p in bar.parts) for bar in bars)
    shapes = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" '
        f'font-family="DejaVu Sans, Arial, sans-serif" font-size="14" fill="{INK}">',
        f'<rect width="{WIDTH}" height="{height}" rx="4" fill="#ffffff"/>',
        f'<text x="16" y="26" font-weight="bold">{escape(title)}</text>',
    ]
    for number, (name, colour) in enumerate(legend):
        x = LABEL + 160 * number
        shapes.append(f'<rect x="{x}" y="42" width="14" height="14" fill="{colour}"/>')
        shapes.append(f'<text x="{x + 20}" y="54">{escape(name)}</text>')
    for number, bar in enumerate(bars):
        shapes += _shapes(bar, top + ROW * number, scale)
    end = top + ROW * len(bars)
    shapes.append(f'<path d="M{LABEL} {top - 4}V{end}" stroke="{GRID}"/>')
    return "\n".join([*shapes, "</svg>", ""])


def _shapes(bar: Bar, y: int, scale: float) -> list[str]:
    """Returns the label, the parts and the text of a bar."""
    line = y + 16
    shapes = [f'<text x="{LABEL - 10}" y="{line}" text-anchor="end">{escape(bar.label)}</text>']
    x = float(LABEL)
    for part in bar.parts:
        width = part.value * scale
        shapes.append(
            f'<rect x="{x:.1f}" y="{y}" width="{width:.1f}" height="{BAR}" fill="{part.colour}"/>'
        )
        x += width
    return [*shapes, f'<text x="{x + 8:.1f}" y="{line}">{escape(bar.text)}</text>']


if __name__ == "__main__":
    for name, figure in figures().items():
        (DOCS / name).write_text(figure, encoding="utf-8")
