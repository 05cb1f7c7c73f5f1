"""The empty flat: floors, walls with windows and doorways, skirting boards and frames.

Coordinates are in the scene's frame, y-up, with the floor at y = 0. There is no ceiling, so that a
camera above the walls can see inside.
"""

from dataclasses import dataclass

import numpy as np

from hab_authoring.apartment import shapes
from hab_authoring.apartment.builder import Builder
from hab_authoring.apartment.model import Convex, Part, StageModel, Vec3

HEIGHT_M, SLAB_M, SKIRTING_M = 2.6, 0.10, 0.08


@dataclass(frozen=True)
class Opening:
    """A hole in a wall, from `start` to `end` along it and from `sill` to `head` in height."""

    start: float
    end: float
    sill: float
    head: float
    kind: str  # "window", "doorway" or "front_door"


@dataclass(frozen=True)
class Wall:
    """A wall's footprint; its run is the longer side."""

    x: tuple[float, float]
    z: tuple[float, float]
    openings: tuple[Opening, ...] = ()
    paint: str | None = None  # a second colour on the side of larger x or z
    paint_low: str | None = None  # one on the other side

    @property
    def along_x(self) -> bool:
        """Whether the wall runs along x."""
        return self.x[1] - self.x[0] > self.z[1] - self.z[0]


@dataclass(frozen=True)
class FloorPlan:
    """A flat without its furniture.

    `floors` are (x span, z span, material) and do not overlap; `panels` are thin visual boxes
    (low corner, high corner, material, bevel): tiles on a wall, a carpet, a threshold.
    """

    name: str
    walls: tuple[Wall, ...]
    floors: tuple[tuple[tuple[float, float], tuple[float, float], str], ...]
    panels: tuple[tuple[Vec3, Vec3, str, float], ...] = ()


FRONT_DOOR = Opening(-1.95, -1.02, 0.0, 2.08, "front_door")


def outer_walls(
    west: tuple[Opening, ...] = (),
    south: tuple[Opening, ...] = (),
    east: tuple[Opening, ...] = (),
    north: tuple[Opening, ...] = (),
    north_west: tuple[Opening, ...] = (),
    paint: str | None = None,
) -> tuple[Wall, ...]:
    """Return the walls around every flat, `paint` on the west one's inside.

    Habitat's ReplicaCAD stage spans x -2.66..4.60 and z -4.76..8.17, and so does this one: an L
    with its north wing (z over 4) at x 0.2..4.4.
    """
    return (
        Wall((-2.66, -2.50), (-4.76, 4.11), west, paint),
        Wall((-2.50, 4.44), (-4.76, -4.60), (FRONT_DOOR, *south)),
        Wall((4.44, 4.60), (-4.76, 8.17), east),
        Wall((0.065, 4.44), (8.01, 8.17), north),
        Wall((0.065, 0.225), (4.11, 8.01)),
        Wall((-2.50, 0.225), (3.95, 4.11), north_west),
    )


def build(plan: FloorPlan) -> StageModel:
    """Return the stage of a floor plan."""
    make, extra = Builder(), []
    for (x0, x1), (z0, z1), material in plan.floors:
        make.span((x0, -SLAB_M, z0), (x1, 0.0, z1), material, 0.0)
    for low, high, material, bevel_m in plan.panels:
        make.span(low, high, material, bevel_m, solid=False)
    for wall in plan.walls:
        _wall(make, wall)
        for opening in wall.openings:
            extra += _opening(make, wall, opening)
    return StageModel(plan.name, make.parts, make.solids() + extra)


def _wall(make: Builder, wall: Wall) -> None:
    run = wall.x if wall.along_x else wall.z
    cuts = sorted(wall.openings, key=lambda o: o.start)
    at = run[0]
    for opening in cuts:
        _piece(make, wall, (at, opening.start), (0.0, HEIGHT_M))
        if opening.sill > 0:
            _piece(make, wall, (opening.start, opening.end), (0.0, opening.sill))
        _piece(make, wall, (opening.start, opening.end), (opening.head, HEIGHT_M))
        at = opening.end
    _piece(make, wall, (at, run[1]), (0.0, HEIGHT_M))


def _piece(make: Builder, wall: Wall, run: tuple[float, float], y: tuple[float, float]) -> None:
    low, high = _corners(wall, run, y, 0.0)
    make.span(low, high, "wall", 0.0)
    for paint, upper in ((wall.paint, True), (wall.paint_low, False)):
        if paint is not None:
            make.span(*_face(wall, _corners(wall, run, y, 0.002), upper), paint, 0.0, solid=False)
    if y[1] == HEIGHT_M:
        low, high = _corners(wall, run, (HEIGHT_M, HEIGHT_M + 0.012), 0.002)
        make.span(low, high, "wall_edge", 0.0, solid=False)
    if y[0] == 0.0:
        low, high = _corners(wall, run, (0.0, SKIRTING_M), 0.012)
        make.span(low, high, "trim", 0.003, solid=False)


def _face(wall: Wall, corners: tuple[Vec3, Vec3], upper: bool) -> tuple[Vec3, Vec3]:
    """Return the sheet that protrudes from one side of a wall's enlarged corners."""
    (x0, y0, z0), (x1, y1, z1) = corners
    if wall.along_x:
        return ((x0, y0, wall.z[1]), (x1, y1, z1)) if upper else ((x0, y0, z0), (x1, y1, wall.z[0]))
    return ((wall.x[1], y0, z0), (x1, y1, z1)) if upper else ((x0, y0, z0), (wall.x[0], y1, z1))


def _corners(
    wall: Wall, run: tuple[float, float], y: tuple[float, float], swell: float
) -> tuple[Vec3, Vec3]:
    """Return two corners of a stretch of the wall, grown sideways by `swell`."""
    if wall.along_x:
        return (run[0], y[0], wall.z[0] - swell), (run[1], y[1], wall.z[1] + swell)
    return (wall.x[0] - swell, y[0], run[0]), (wall.x[1] + swell, y[1], run[1])


def _opening(make: Builder, wall: Wall, hole: Opening) -> list[Convex]:
    """Add the joinery of an opening, and return its closing parts."""
    rim, out = 0.05 if hole.kind == "window" else 0.07, 0.014
    for run, y in (
        ((hole.start - rim, hole.start + 0.004), (hole.sill, hole.head + rim)),
        ((hole.end - 0.004, hole.end + rim), (hole.sill, hole.head + rim)),
        ((hole.start, hole.end), (hole.head - 0.004, hole.head + rim)),
    ):
        make.span(*_corners(wall, run, y, out), "trim", 0.004, solid=False)
    if hole.kind == "window":
        return _window(make, wall, hole)
    if hole.kind == "front_door":
        return _front_door(make, wall, hole)
    return []


def _inset(wall: Wall, share: float, thick_m: float) -> float:
    """Return how much to grow the wall's footprint so that a sheet of `thick_m` remains."""
    width = (wall.z if wall.along_x else wall.x)[1] - (wall.z if wall.along_x else wall.x)[0]
    return -(width - thick_m) / 2 * share


def _window(make: Builder, wall: Wall, hole: Opening) -> list[Convex]:
    bar, middle = 0.045, (hole.start + hole.end) / 2
    make.span(
        *_corners(wall, (hole.start - 0.03, hole.end + 0.03), (hole.sill - 0.03, hole.sill), 0.045),
        "trim",
        0.006,
        solid=False,
    )
    frame = _inset(wall, 1.0, 0.05)
    stiles = (hole.start, middle - bar / 2, hole.end - bar)
    for start in stiles:
        make.span(
            *_corners(wall, (start, start + bar), (hole.sill, hole.head), frame),
            "trim",
            0.004,
            solid=False,
        )
    for low in (hole.sill, hole.head - bar):
        make.span(
            *_corners(wall, (hole.start, hole.end), (low, low + bar), frame),
            "trim",
            0.004,
            solid=False,
        )
    pane = _corners(wall, (hole.start, hole.end), (hole.sill, hole.head), _inset(wall, 1.0, 0.006))
    make.see(*_panorama(wall, pane))
    solid = Builder()
    solid.span(*_corners(wall, (hole.start, hole.end), (hole.sill, hole.head), frame), "trim")
    return solid.solids()


def _panorama(wall: Wall, pane: tuple[Vec3, Vec3]) -> list[Part]:
    """Return the picture behind a window, once over the pane on either side."""
    (x0, y0, z0), (x1, y1, z1) = pane
    ends = [(x0, z1), (x1, z1)] if wall.along_x else [(x1, z0), (x1, z1)]
    (ax, az), (bx, bz) = ends
    points = np.array([[ax, y0, az], [bx, y0, bz], [bx, y1, bz], [ax, y1, az]])
    uv = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    normal = np.array([0.0, 0.0, 1.0] if wall.along_x else [1.0, 0.0, 0.0])
    out = []
    for sign, fan in ((1.0, [[0, 1, 2], [0, 2, 3]]), (-1.0, [[0, 2, 1], [0, 3, 2]])):
        # The run along z is left-handed seen from +x.
        faces = np.array(fan) if wall.along_x else np.array(fan)[:, ::-1]
        out.append(Part(points, np.tile(sign * normal, (4, 1)), uv, faces, "view"))
    return out


def _front_door(make: Builder, wall: Wall, hole: Opening) -> list[Convex]:
    leaf = _corners(wall, (hole.start, hole.end), (0.004, hole.head), _inset(wall, 1.0, 0.06))
    make.span(*leaf, "walnut", 0.003, solid=False)
    face = wall.z[1] - 0.05
    for low, high in ((0.2, 0.95), (1.1, 1.9)):
        center = ((hole.start + hole.end) / 2, (low + high) / 2, face)
        make.see(shapes.box(center, (0.62, high - low, 0.014), "walnut", 0.005))
    x = hole.end - 0.09
    make.see(shapes.cylinder((x, 1.02, face + 0.02), 0.026, 0.02, "brass", "z"))
    make.see(shapes.sphere((x, 1.02, face + 0.055), (0.03, 0.03, 0.025), "brass"))
    solid = Builder()
    solid.span(*leaf, "walnut")
    return solid.solids()
