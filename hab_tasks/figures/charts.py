"""Figures 6 and 7: furniture in the micro-variations, and semantic categories of the objects."""

from __future__ import annotations

import math
from pathlib import Path

from hab_tasks.figures.statistics import category_counts, furniture_counts
from hab_tasks.figures.style import BAR_HEIGHT_IN, bars, new_figure, save
from hab_tasks.scenes.habitat.dataset import SceneDataset
from hab_tasks.scenes.habitat.inventory import macro_layouts, micro_variations

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
