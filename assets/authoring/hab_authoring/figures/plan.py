"""Floor plans: top view of a layout's collision shapes."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from hab_tasks.figure_style import EDGE, ORANGE
from hab_tasks.geometry import Array
from hab_tasks.world.scenes.floor import footprints
from hab_tasks.world.scenes.layout_geometry import STAGE, Layout
from hab_tasks.world.scenes.spec import SceneSpec

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
