"""Top views of wild layouts, with the kitchen marked."""

from __future__ import annotations

from pathlib import Path

from hab_tasks.figures.plan import aspect, draw_plan, outlines
from hab_tasks.figures.style import new_figure, save
from hab_tasks.layouts.furnishing import COUNTER, CUPBOARD
from hab_tasks.scenes.habitat.dataset import SceneDataset
from hab_tasks.scenes.habitat.load import load_scene
from hab_tasks.scenes.markers import FRIDGES

SHOWN, VIEW_IN = 6, 1.7


def draw_wild(dataset: SceneDataset, file: Path, shown: int = SHOWN) -> None:
    """Draws floor plans of the first layouts of a folder from `hab-tasks vary --wild`.

    Args:
        dataset: The folder of layouts.
        file: The PNG.
        shown: Number of layouts.
    """
    specs = [load_scene(dataset, scene_id) for scene_id in sorted(dataset.scene_files)[:shown]]
    plans = [outlines(spec) for spec in specs]
    height_in = (VIEW_IN - 0.1) * max(map(aspect, plans)) + 0.4
    figure = new_figure(VIEW_IN * len(specs), height_in)
    places = figure.subplots(1, len(specs), squeeze=False)[0]
    for axes, spec, plan in zip(places, specs, plans, strict=True):
        wanted = (*FRIDGES, COUNTER, CUPBOARD)
        kitchen = {a.name for a in spec.articulations if a.template in wanted}
        draw_plan(axes, plan, kitchen)
        axes.set_title(spec.scene_id, fontsize=9)
    save(figure, file)
