"""Style and output of all figures: no display needed, reproducible bytes.

Colours are Okabe and Ito's palette for colour-blind readers; markers, hatches or words repeat the
information of colours.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from hab_tasks.files import written_aside

BLUE, ORANGE, GREEN, VERMILION = "#0072B2", "#E69F00", "#009E73", "#D55E00"
FLOOR, WALL, PIECE, EDGE, PALE = "#F4F1EA", "#5F6368", "#C3C9CF", "#6B7075", "#D8DCE0"
FLAT, FLAT_MARKED = "#E6E5E2", "#F9E3B4"
DPI = 150
BAR_HEIGHT_IN = 0.22


def new_figure(width_in: float, height_in: float) -> Figure:
    """Returns an empty figure that needs no display."""
    figure = Figure(figsize=(width_in, height_in), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, file: Path) -> None:
    """Writes a PNG atomically; equal figures give equal bytes."""
    with written_aside(file) as scratch:
        figure.savefig(scratch, metadata={"Software": None})


def bars(
    axes: Axes,
    counts: Mapping[str, int],
    *,
    extra: Mapping[str, int] | None = None,
    names: tuple[str, str] = ("", ""),
    rows: int | None = None,
) -> None:
    """Draws counts as horizontal bars with their numbers; the first is on top.

    Args:
        axes: The axes.
        counts: Label -> number.
        extra: Additional counts, stacked pale and hatched.
        names: Legend of the two kinds.
        rows: Number of bars to leave room for, so that neighbouring axes have equal bar heights.
    """
    more = extra or {}
    labels = sorted(counts.keys() | more.keys(), key=lambda x: (-counts.get(x, 0), x))
    at = range(len(labels))
    main, added = [counts.get(x, 0) for x in labels], [more.get(x, 0) for x in labels]
    ends = [a + b for a, b in zip(main, added, strict=True)]
    axes.barh(at, main, height=0.72, color=BLUE, label=names[0])
    if extra:
        pale = {"color": PALE, "edgecolor": EDGE, "linewidth": 0.5, "hatch": "////"}
        axes.barh(at, added, left=main, height=0.72, label=names[1], **pale)
        placement = {"loc": "lower right", "bbox_to_anchor": (1.0, 0.99), "ncols": 2}
        axes.legend(fontsize=8, frameon=False, borderaxespad=0.1, **placement)
    for row, (a, b, end) in enumerate(zip(main, added, ends, strict=True)):
        words = f"{a} + {b}" if extra else str(a)
        axes.annotate(
            words, (end, row), xytext=(3, 0), textcoords="offset points", va="center", fontsize=8
        )
    axes.set_yticks(at, labels, fontsize=8.5)
    axes.set_ylim(max(rows or 0, len(labels)) - 0.4, -0.6)
    axes.set_xlim(0, 1.15 * max(ends, default=1))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    bare(axes)


def bare(axes: Axes) -> None:
    """Removes the parts of the frame that are not needed to read the axes."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(axis="both", length=2.5)
    axes.tick_params(axis="x", labelsize=8)
