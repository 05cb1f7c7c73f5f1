"""Figure 8: top views of the macro layouts, a sheet of their micro-variations, wild layouts.

A floor plan is a top view of a layout's collision shapes. Furniture of a micro-variation is marked
if its pose differs from that in its macro layout (S A.1).
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from scipy.optimize import linear_sum_assignment
from transforms3d.quaternions import qconjugate, qmult

from hab_authoring.inventory import macro_layouts, macro_of, micro_variations
from hab_authoring.layouts.furnishing import COUNTER, CUPBOARD
from hab_authoring.showroom import Showroom
from hab_tasks.articulations import FRIDGES
from hab_tasks.figure_style import EDGE, ORANGE, new_figure, save
from hab_tasks.geometry import Array, Pose7
from hab_tasks.world.scenes.floor import footprints
from hab_tasks.world.scenes.habitat.dataset import SceneDataset
from hab_tasks.world.scenes.habitat.load import load_scene
from hab_tasks.world.scenes.layout_geometry import STAGE, Layout
from hab_tasks.world.scenes.spec import SceneSpec

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


FLOOR, WALL, PIECE = "#F4F1EA", "#5F6368", "#C3C9CF"
FLAT, FLAT_MARKED = "#E6E5E2", "#F9E3B4"
FLOOR_TOP_M, FLAT_TOP_M = 0.05, 0.1
"""Parts of the stage below this are floor; furniture below this are rugs and mats."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Outline:
    """Outline of one collision shape in a top view.

    Attributes:
        piece: The object's or furniture's name; ``floor`` and ``wall`` for the stage.
        corners_m: (K, 2) its convex outline in the world.
        top_m: Height of its highest point.
    """

    piece: str
    corners_m: Array
    top_m: float


def outlines(spec: SceneSpec) -> list[Outline]:
    """Returns the outlines of all bodies of a layout, doors and drawers closed."""
    found = []
    for body in Layout.of(spec).placed.values():
        for shape in footprints(body.points_m, body.shapes.starts):
            piece = body.piece
            if piece == STAGE:
                piece = "floor" if shape.high_m < FLOOR_TOP_M else "wall"
            found.append(Outline(piece=piece, corners_m=shape.outline_m, top_m=shape.high_m))
    return found


def room_box(found: list[Outline]) -> tuple[Array, Array]:
    """Returns the lowest and highest corner (2,), (2,) of the room [m]: its walls and floor."""
    stage = [o.corners_m for o in found if o.piece in ("floor", "wall")]
    corners = np.concatenate(stage or [o.corners_m for o in found])
    return corners.min(axis=0), corners.max(axis=0)


def aspect(found: list[Outline]) -> float:
    """Returns the room's height, as it is drawn, divided by its width."""
    low, high = room_box(found)
    return float((high[1] - low[1]) / (high[0] - low[0]))


def draw_plan(axes: Axes, found: list[Outline], marked: Collection[str] = ()) -> None:
    """Draws a floor plan that fills the axes; pieces in `marked` are orange."""
    pieces: dict[str, list[Outline]] = {}
    for part in found:
        pieces.setdefault(part.piece, []).append(part)
    for piece, parts in sorted(pieces.items(), key=lambda item: _layer(item[1])):
        color, edge = _colors(piece, parts, piece in marked)
        corners = [part.corners_m for part in parts]
        # Edges first, then fills over them, which leaves the outline of the whole piece.
        axes.add_collection(PolyCollection(corners, facecolors="none", edgecolors=edge, lw=1.0))
        axes.add_collection(PolyCollection(corners, facecolors=color, edgecolors=color, lw=0.2))
    low, high = room_box(found)
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal")
    axes.set_axis_off()


def _colors(piece: str, parts: list[Outline], marked: bool) -> tuple[str, str]:
    if piece in ("floor", "wall"):
        return (FLOOR, FLOOR) if piece == "floor" else (WALL, WALL)
    if max(part.top_m for part in parts) < FLAT_TOP_M:
        return (FLAT_MARKED, ORANGE) if marked else (FLAT, PIECE)
    return (ORANGE, WALL) if marked else (PIECE, EDGE)


def _layer(parts: list[Outline]) -> tuple[int, float, str]:
    """Sorts floors first, then walls, then everything else by height."""
    piece = parts[0].piece
    return {"floor": 0, "wall": 1}.get(piece, 2), max(part.top_m for part in parts), piece


MOVED_M = 0.05
TURNED_RAD = math.radians(5.0)


def moved_furniture(macro: SceneSpec, variation: SceneSpec) -> set[str]:
    """Returns the names of the variation's furniture that was moved, rotated or added.

    Pieces of one template are interchangeable: each is matched one to one with the nearest piece of
    the macro layout.
    """
    before, after = _by_template(macro), _by_template(variation)
    moved: set[str] = set()
    for template, pieces in after.items():
        names, poses = zip(*pieces, strict=True)
        old = [pose for _, pose in before.get(template, [])]
        kept: set[int] = set()
        if old:
            distance = np.linalg.norm(_positions(poses)[:, None] - _positions(old), axis=2)
            for new, at in zip(*linear_sum_assignment(distance), strict=True):
                if distance[new, at] <= MOVED_M and _angle(poses[new], old[at]) <= TURNED_RAD:
                    kept.add(int(new))
        moved |= {name for index, name in enumerate(names) if index not in kept}
    return moved


def _by_template(spec: SceneSpec) -> dict[str, list[tuple[str, Pose7]]]:
    found = defaultdict(list)
    for item in spec.objects:
        if not item.dynamic:
            found[item.template.name].append((item.name, item.world_from_object))
    for furniture in spec.articulations:
        found[furniture.template].append((furniture.name, furniture.world_from_root))
    return found


def _positions(poses: Iterable[Pose7]) -> Array:
    return np.array([pose[:3] for pose in poses])


def _angle(a: Pose7, b: Pose7) -> float:
    """Angle [rad] of the rotation from one pose to the other."""
    w = abs(float(qmult(a[3:], qconjugate(b[3:]))[0]))
    return 2 * math.acos(min(w, 1.0))
