"""Figures 6 and 7: furniture in the micro-variations, and semantic categories of the objects."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from hab_authoring.figures.statistics import category_counts, furniture_counts
from hab_authoring.inventory import macro_layouts, micro_variations
from hab_tasks.figure_style import BLUE, EDGE, bare, new_figure, save
from hab_tasks.world.scenes.habitat.dataset import SceneDataset

PALE = "#D8DCE0"
BAR_HEIGHT_IN = 0.22
COLUMN_IN = 5.0
MARGIN_IN = 1.0
LONGEST_COLUMN = 25


def draw_furniture(dataset: SceneDataset, file: Path) -> None:
    """Draws the count of each furniture type in the micro-variations (S Fig. 6)."""
    layouts, macros = len(micro_variations(dataset)), len(macro_layouts(dataset))
    title = f"{dataset.name}: furniture in {layouts} micro-variations of {macros} macro layouts"
    _draw(furniture_counts(dataset), title, "occurrences", file)


def draw_categories(dataset: SceneDataset, file: Path) -> None:
    """Draws the number of object templates per semantic category (S Fig. 7)."""
    counts = category_counts(dataset)
    title = f"{dataset.name}: {sum(counts.values())} objects in {len(counts)} semantic categories"
    _draw(counts, title, "object templates", file)


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


def _draw(counts: dict[str, int], title: str, unit: str, file: Path) -> None:
    columns = max(1, math.ceil(len(counts) / LONGEST_COLUMN))
    rows = math.ceil(len(counts) / columns)
    figure = new_figure(COLUMN_IN * max(columns, 1.4), MARGIN_IN + BAR_HEIGHT_IN * max(rows, 3))
    parts = figure.subplots(1, columns, sharex=True, squeeze=False)[0]
    entries = list(counts.items())
    for index, axes in enumerate(parts):
        bars(axes, dict(entries[index * rows : (index + 1) * rows]), rows=rows)
        axes.set_xlabel(unit, fontsize=9)
    parts[0].set_xlim(0, 1.15 * max(counts.values(), default=1))
    figure.suptitle(title, fontsize=10.5)
    save(figure, file)
