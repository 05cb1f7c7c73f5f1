"""Figures 20 to 22: objects, receptacles and positions of an episode file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import SubFigure

from hab_authoring.figures.layouts import (
    WALL,
    Outline,
    aspect,
    draw_plan,
    moved_furniture,
    outlines,
)
from hab_authoring.figures.statistics import (
    BAR_HEIGHT_IN,
    EpisodeStatistics,
    bars,
    episode_statistics,
)
from hab_tasks.episodes.schema import EpisodeSet
from hab_tasks.figure_style import BLUE, ORANGE, bare, new_figure, save
from hab_tasks.geometry import Array
from hab_tasks.world.scenes.habitat.dataset import SceneDataset
from hab_tasks.world.scenes.habitat.load import load_scene

PAPER_FIGURES = {
    "HabTidyHouse-v1": "fig20_tidy_house.png",
    "HabSetTable-v1": "fig21_set_table.png",
    "HabPrepareGroceries-v1": "fig22_prepare_groceries.png",
}
CHART_IN, PLAN_IN = 4.6, 3.0
HISTOGRAM_ROWS, TITLE_ROWS = 8, 3.5
THICKER = 1.4
"""Maximum growth factor of bars where there is room."""

MANY = 150
"""Number of points in one plan from which markers are smaller."""

BIN_M = 0.5
MARKERS = {
    "robot starts": {"marker": "x", "color": WALL, "s": 14, "linewidths": 0.8, "alpha": 0.7},
    "object starts": {"marker": "o", "color": BLUE, "s": 14, "linewidths": 0, "alpha": 0.75},
    "goals": {"marker": "^", "color": ORANGE, "s": 20, "edgecolors": "k", "linewidths": 0.4},
}


@dataclass(frozen=True, kw_only=True)
class _Panel:
    """One chart; its height in rows of bars."""

    title: str
    rows: float
    draw: Callable[[Axes], None]


def figure_name(env_id: str) -> str:
    """Returns the file name of an environment's figure."""
    return PAPER_FIGURES.get(env_id, f"episodes_{env_id}.png")


def draw_episodes(dataset: SceneDataset, episodes: EpisodeSet, file: Path) -> None:
    """Draws an episode file's objects, receptacles, distances and positions (S Figs. 20-22)."""
    statistics = episode_statistics(episodes)
    plans = {layout: _plan(dataset, scenes) for layout, scenes in statistics.scenes.items()}
    columns = _columns(_panels(statistics))
    rows = max((sum(panel.rows + TITLE_ROWS for panel in c) for c in columns), default=0)
    height_in = max(BAR_HEIGHT_IN * rows, PLAN_IN * max(map(aspect, plans.values()))) + 0.8
    widths = [CHART_IN] * len(columns) + [PLAN_IN * len(plans)]
    figure = new_figure(sum(widths), height_in)
    figure.suptitle(
        f"{episodes.env} on {episodes.scene_dataset}, {episodes.split}: {len(episodes)} episodes",
        fontsize=11,
    )
    parts = figure.subfigures(1, len(widths), width_ratios=widths, squeeze=False)[0]
    for part, column in zip(parts, columns, strict=False):
        _draw_column(part, column, (height_in - 0.8) / BAR_HEIGHT_IN)
    _draw_positions(parts[-1], statistics, plans)
    save(figure, file)


def _panels(statistics: EpisodeStatistics) -> list[_Panel]:
    panels = []
    if statistics.objects or statistics.clutter:
        draw = partial(
            bars, counts=statistics.objects, extra=statistics.clutter, names=("targets", "clutter")
        )
        rows = len(statistics.objects.keys() | statistics.clutter.keys())
        panels.append(_Panel(title="Objects", rows=rows, draw=draw))
    counted = {
        "Where targets start": statistics.starts,
        "Where targets go": statistics.goals,
        "Doors and drawers": statistics.handles,
    }
    panels += [
        _Panel(title=title, rows=len(counts), draw=partial(bars, counts=counts))
        for title, counts in counted.items()
        if counts
    ]
    if len(statistics.distances_m):
        draw = partial(_draw_distances, distances_m=statistics.distances_m)
        panels.append(_Panel(title="From start to goal", rows=HISTOGRAM_ROWS, draw=draw))
    return panels


def _columns(panels: list[_Panel]) -> list[list[_Panel]]:
    """Returns at most two columns of about the same height."""
    columns: list[list[_Panel]] = [[], []]
    for panel in panels:
        min(columns, key=lambda column: sum(p.rows + TITLE_ROWS for p in column)).append(panel)
    return [column for column in columns if column]


def _draw_column(part: SubFigure, column: list[_Panel], rows: float) -> None:
    """Stacks charts in a column of a number of rows; spare room stays empty."""
    heights = [panel.rows + TITLE_ROWS for panel in column]
    spare = max(rows / THICKER - sum(heights), 1e-3)
    all_axes = part.subplots(len(column) + 1, 1, squeeze=False, height_ratios=[*heights, spare])[
        :, 0
    ]
    all_axes[-1].set_axis_off()
    for axes, panel in zip(all_axes, column, strict=False):
        panel.draw(axes)
        axes.set_title(panel.title, fontsize=10, loc="left")


def _draw_distances(axes: Axes, distances_m: Array) -> None:
    edges = np.arange(0.0, distances_m.max() + BIN_M, BIN_M)
    axes.hist(distances_m, bins=edges.tolist(), color=BLUE, edgecolor="white", linewidth=0.6)
    mean_m = float(distances_m.mean())
    axes.axvline(mean_m, color="black", linestyle="--", linewidth=1.2)
    axes.set_xlabel(f"straight line [m], dashed: mean {mean_m:.2f} m", fontsize=9)
    axes.set_ylabel("targets", fontsize=9)
    axes.tick_params(axis="y", labelsize=8)
    bare(axes)


def _draw_positions(
    part: SubFigure, statistics: EpisodeStatistics, plans: dict[str, list[Outline]]
) -> None:
    found = (statistics.robot_m, statistics.start_m, statistics.goal_m)
    shown: dict[str, Artist] = {}
    for axes, (layout, plan) in zip(
        part.subplots(1, len(plans), squeeze=False)[0], plans.items(), strict=True
    ):
        draw_plan(axes, plan)
        for (name, look), points in zip(MARKERS.items(), found, strict=True):
            if layout in points:
                size = look["s"] * min(1.0, max(0.35, MANY / len(points[layout])))
                shown[name] = axes.scatter(*points[layout].T, zorder=3, **{**look, "s": size})
        scenes = len(statistics.scenes[layout])
        axes.set_title(layout if scenes == 1 else f"{layout}, {scenes} layouts", fontsize=10)
    words = {"ncols": 3, "fontsize": 8, "frameon": False, "handletextpad": 0.2}
    part.legend(shown.values(), shown.keys(), loc="outside lower center", **words)


def _plan(dataset: SceneDataset, scenes: list[str]) -> list[Outline]:
    """Returns outlines of bodies with the same pose in all these layouts."""
    first = load_scene(dataset, scenes[0])
    moved: set[str] = set()
    for scene_id in scenes[1:]:
        moved |= moved_furniture(load_scene(dataset, scene_id), first)
    return [part for part in outlines(first) if part.piece not in moved]
