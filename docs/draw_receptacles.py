"""Draws the receptacles of a layout of the apartment for the page of concepts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from hab_authoring.figures.layouts import aspect, draw_plan, outlines
from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from hab_tasks.figure_style import new_figure, save
from hab_tasks.geometry import Array, to_matrix
from hab_tasks.receptacles import PHRASES
from hab_tasks.world.scenes.habitat.dataset import resolve_dataset
from hab_tasks.world.scenes.habitat.load import load_scene
from hab_tasks.world.scenes.layout_geometry import Layout
from hab_tasks.world.scenes.spec import Receptacle

FILE = Path(__file__).with_name("receptacles.png")
SCENE, WIDTH_IN, COLOUR = "v3_sc0_staging_00", 3.6, "#0072b2"
ASIDE = ("drawer", "sink")  # their names are written in front of the kitchen counter
CORNERS = ((-1, -1), (1, -1), (1, 1), (-1, 1))


def draw() -> None:
    """Draws a floor plan turned by 90 degrees, with the receptacles in blue."""
    spec = load_scene(resolve_dataset("apartment"), SCENE)
    plan = outlines(spec)
    figure = new_figure(WIDTH_IN * aspect(plan) + 1.6, WIDTH_IN)
    axes = figure.subplots()
    turned = [type(o)(piece=o.piece, corners_m=_turned(o.corners_m), top_m=o.top_m) for o in plan]
    draw_plan(axes, turned)
    layout, said = Layout.of(spec), set[str]()
    for receptacle in spec.receptacles:
        words = PHRASES.get(receptacle.name)
        if words is not None:
            _mark(axes, _box(receptacle, layout), "" if words in said else words)
            said.add(words)
    save(figure, FILE)


def _turned(points_m: Array) -> Array:
    """Maps (K, 2) points of the world to the figure."""
    return np.stack((points_m[:, 1], -points_m[:, 0]), axis=1)


def _box(receptacle: Receptacle, layout: Layout) -> Array:
    """Returns the (K, 2) outline of a receptacle in the figure."""
    world_from_box = layout.placed[receptacle.body].world_from_body @ to_matrix(
        receptacle.body_from_box
    )
    half = np.array(receptacle.half_size_m)
    level = [axis for axis in range(3) if abs(world_from_box[2, axis]) < 0.5]
    local = np.zeros((4, 3))
    local[:, level] = np.array(CORNERS) * half[level]
    return _turned((local @ world_from_box[:3, :3].T + world_from_box[:3, 3])[:, :2])


def _mark(axes: Axes, corners_m: Array, words: str) -> None:
    """Draws a receptacle, with its name if `words` has one."""
    axes.add_patch(Polygon(corners_m, facecolor=COLOUR, alpha=0.55, edgecolor=COLOUR, lw=1.0))
    name = words.partition(" the ")[2]
    if name:
        axes.annotate(
            name,
            corners_m.mean(axis=0),
            (0, -20 if name in ASIDE else 0),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=6,
            bbox={"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.8},
        )


if __name__ == "__main__":
    draw()
