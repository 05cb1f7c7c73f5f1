"""Figure 8: top views of the macro layouts, a sheet of their micro-variations, wild layouts."""

from __future__ import annotations

from pathlib import Path

from hab_authoring.figures.moved import moved_furniture
from hab_authoring.figures.plan import aspect, draw_plan, outlines, room_box
from hab_authoring.inventory import macro_layouts, macro_of, micro_variations
from hab_authoring.layouts.furnishing import COUNTER, CUPBOARD
from hab_authoring.showroom import Showroom
from hab_tasks.figure_style import new_figure, save
from hab_tasks.world.scenes.habitat.dataset import SceneDataset
from hab_tasks.world.scenes.habitat.load import load_scene
from hab_tasks.world.scenes.markers import FRIDGES

PIXELS_PER_M = 60.0
VIEW_IN, SHEET_IN = 2.4, 0.95
"""Widths of one layout in the two figures."""

SHEET_COLUMNS = 11
WILD_SHOWN, WILD_IN = 6, 1.7


def draw_macros(dataset: SceneDataset, file: Path, backend: str) -> None:
    """Draws top views of the macro layouts (S Fig. 8).

    Args:
        dataset: The scene dataset.
        file: The PNG.
        backend: ManiSkill's name of the render device; ``none`` for floor plans.
    """
    showroom = None if backend == "none" else Showroom(backend)
    specs = [load_scene(dataset, scene_id) for scene_id in macro_layouts(dataset)]
    plans = [outlines(spec) for spec in specs]
    height_in = (VIEW_IN - 0.1) * max(map(aspect, plans)) + 0.4
    figure = new_figure(VIEW_IN * len(specs), height_in)
    all_axes = figure.subplots(1, len(specs), squeeze=False)[0]
    for axes, spec, plan in zip(all_axes, specs, plans, strict=True):
        if showroom is None:
            draw_plan(axes, plan)
        else:
            picture = showroom.top_view(spec, *room_box(plan), PIXELS_PER_M)
            axes.imshow(picture, interpolation="lanczos")
        axes.set_axis_off()
        axes.set_title(spec.scene_id, fontsize=9)
    save(figure, file)


def draw_micros(dataset: SceneDataset, file: Path) -> None:
    """Draws a sheet: each macro layout, followed by its micro-variations.

    Furniture at a different pose than in the macro layout is marked.
    """
    macros = macro_layouts(dataset)
    groups = {m: [m, *micro_variations(dataset, macro_of(m))] for m in macros}
    lines = [
        (load_scene(dataset, macro), scenes[at : at + SHEET_COLUMNS])
        for macro, scenes in groups.items()
        for at in range(0, len(scenes), SHEET_COLUMNS)
    ]
    columns = max(len(scenes) for _, scenes in lines)
    tallest = max(aspect(outlines(macro)) for macro, _ in lines)
    height_in = ((SHEET_IN - 0.1) * tallest + 0.2) * len(lines) + 0.4
    figure = new_figure(SHEET_IN * columns, height_in)
    grid = figure.subplots(len(lines), columns, squeeze=False)
    for axes in grid.flat:
        axes.set_axis_off()
    for (macro, scenes), all_axes in zip(lines, grid, strict=True):
        for scene_id, axes in zip(scenes, all_axes, strict=False):
            spec = load_scene(dataset, scene_id)
            draw_plan(axes, outlines(spec), moved_furniture(macro, spec))
            axes.set_title(scene_id.removeprefix("v3_").replace("_staging_", " "), fontsize=7.5)
    title = f"{dataset.name}: each macro layout (00) and its micro-variations, what moved in orange"
    figure.suptitle(title, fontsize=10)
    save(figure, file)


def draw_wild(dataset: SceneDataset, file: Path, shown: int = WILD_SHOWN) -> None:
    """Draws floor plans of the first layouts of a folder from `hab-tasks vary --wild`.

    Args:
        dataset: The folder of layouts.
        file: The PNG.
        shown: Number of layouts.
    """
    specs = [load_scene(dataset, scene_id) for scene_id in sorted(dataset.scene_files)[:shown]]
    plans = [outlines(spec) for spec in specs]
    height_in = (WILD_IN - 0.1) * max(map(aspect, plans)) + 0.4
    figure = new_figure(WILD_IN * len(specs), height_in)
    places = figure.subplots(1, len(specs), squeeze=False)[0]
    for axes, spec, plan in zip(places, specs, plans, strict=True):
        wanted = (*FRIDGES, COUNTER, CUPBOARD)
        kitchen = {a.name for a in spec.articulations if a.template in wanted}
        draw_plan(axes, plan, kitchen)
        axes.set_title(spec.scene_id, fontsize=9)
    save(figure, file)
