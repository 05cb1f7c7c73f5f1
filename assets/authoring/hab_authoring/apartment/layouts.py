"""The furnished flats of `macros.toml` and `dense.toml`.

Scene frame: y up, floor at y = 0; north is +z, east is +x. A row has the fields of `Item`, `Thing`
or `Opening` in their order, a table at its end further ones by name; a wall is a table of `Wall`'s
fields. A lamp is x, z and intensity, and where they differ from most, its height and colour.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from hab_authoring.apartment.model import (
    Light,
    ObjectModel,
    Placement,
    SceneModel,
    full_name,
    read_table,
)
from hab_authoring.apartment.shell import FloorPlan, Opening, Wall, outer_walls

# Angles about +y by which +z comes to point there.
_HEADINGS_RAD = {"north": 0.0, "east": math.pi / 2, "south": math.pi, "west": -math.pi / 2}
# Where the front is in a template's frame; +z for the others.
_FRONTS_MINUS_Z = ("sofa", "chair", "cushion", "table", "tv_screen", "tvstand", "rug", "mat",
                   "remote-control", "apartment_bed")  # fmt: skip
_FRONTS_PLUS_X = ("fridge", "kitchen_counter", "kitchenCupboard", "chestOfDrawers")


@dataclass(frozen=True)
class Item:
    """A placed object: it stands on `level_m`, or hangs with its origin at `y_m`.

    `facing` is the direction of its front, `turn_rad` an additional rotation about +y.
    """

    template: str
    x: float
    z: float
    facing: str | None = None
    turn_rad: float = 0.0
    level_m: float = 0.0
    y_m: float | None = None
    tilt_rad: float = 0.0


@dataclass(frozen=True)
class Thing:
    """A loose object, or a stack of them joined by "+", its allowed surfaces and its count."""

    template: str
    places: tuple[str, ...]  # patterns of "template/surface"
    count: int = 1
    turn_rad: float = 0.2  # how far it may be turned from its place's front, to either side


@dataclass(frozen=True)
class Layout:
    """A furnished flat as data."""

    name: str
    plan: FloorPlan
    lighting: str
    items: tuple[Item, ...]
    articulations: tuple[Placement, ...]
    lights: tuple[Light, ...]

    def scene(self, feet_m: Mapping[str, float]) -> SceneModel:
        """Return the scene with everything fixed; `feet_m` as from the function of that name."""
        objects = [placed(item, feet_m) for item in self.items]
        return SceneModel(
            self.name, self.plan.name, self.lighting, objects, list(self.articulations)
        )


def feet_m(objects: Iterable[ObjectModel]) -> dict[str, float]:
    """Return the depth of each object's collision shape below its origin."""
    return {
        item.name: -round(min(float(solid.vertices[:, 1].min()) for solid in item.solids), 6)
        for item in objects
    }


def placed(item: Item, feet_m: Mapping[str, float], *, dynamic: bool = False) -> Placement:
    """Return an item as a placement."""
    name = full_name(item.template)
    y = item.level_m + feet_m[name] if item.y_m is None else item.y_m
    yaw = yaw_rad(item.template, item.facing) + item.turn_rad
    return Placement(name, (item.x, y, item.z), yaw, item.tilt_rad, dynamic)


def front_rad(template: str) -> float:
    """Return the heading of a template's front in its own frame."""
    if template.startswith(_FRONTS_MINUS_Z):
        return math.pi
    return math.pi / 2 if template.startswith(_FRONTS_PLUS_X) else 0.0


def yaw_rad(template: str, facing: str | None) -> float:
    """Return the rotation about +y that makes a template's front face a direction."""
    if facing is None:
        return 0.0
    turn = math.remainder(_HEADINGS_RAD[facing] - front_rad(template), 2 * math.pi)
    return math.pi if math.isclose(turn, -math.pi) else turn


def _kitchen(wall: float, along: float, facing: str) -> tuple[Placement, ...]:
    """Return fridge, counter and wall cupboards in a row against a wall.

    Args:
        wall: Coordinate of the wall's face: x for rows that face east or west, else z.
        along: Coordinate of the fridge's center on the other axis. The row extends 4 m from the
            fridge's outer side, to the right as seen when looking out of it.
        facing: Direction of the doors.
    """
    yaw = yaw_rad("fridge", facing)
    c, s = math.cos(yaw), math.sin(yaw)
    origin = (wall, along) if abs(c) > 0.5 else (along, wall)
    row = []
    for template, out, beside, y in (
        ("fridge", 0.320, 0.0, 1.01),
        ("kitchen_counter", 0.510, 1.974, 0.03),
        ("kitchenCupboard_01", 0.205, 1.974, 1.53),
    ):
        x, z = origin[0] + c * out + s * beside, origin[1] - s * out + c * beside
        row.append(Placement(template, (round(x, 6), y, round(z, 6)), yaw))
    return tuple(row)


def macros() -> list[Layout]:
    """Return the macro layouts."""
    return [_macro(name, entry) for name, entry in read_table("macros.toml").items()]


def dense(macro_layouts: Iterable[Layout]) -> tuple[list[Layout], list[Thing]]:
    """Return the densely furnished flats, without clutter, and their clutter."""
    data, bases = read_table("dense.toml"), {layout.name: layout for layout in macro_layouts}
    base, parts = bases[data["walls_of"]], data["arrangements"]
    plan = replace(base.plan, name=data["stage"], floors=_tuples(data["floors"]))
    flats = []
    for name, *chosen in data["flats"]:
        entry = {"kitchen": data["kitchen"], "door": data["door"]}
        for part in chosen:
            entry |= parts[part]
        items = tuple(_row(Item, item) for part in chosen for item in parts[part]["items"])
        flats.append(Layout(name, plan, data["stage"], items, _articulations(entry), base.lights))
    return flats, [_row(Thing, thing) for thing in data["things"]]


def _macro(name: str, entry: Mapping[str, Any]) -> Layout:
    sides = {
        side: tuple(Opening(*hole, kind="window") for hole in holes)
        for side, holes in entry["windows"].items()
    }
    walls = [
        Wall(**_tuples(wall) | {"openings": tuple(Opening(*o) for o in wall.get("openings", ()))})
        for wall in entry["walls"]
    ]
    plan = FloorPlan(
        entry["stage"],
        (*outer_walls(**sides, paint=entry.get("paint")), *walls),
        _tuples(entry["floors"]),
        _tuples(entry["panels"]),
    )
    items = tuple(_row(Item, item) for room in entry["rooms"].values() for item in room)
    lights = tuple(_lamp(*lamp) for lamp in entry["lamps"])
    return Layout(name, plan, entry["lighting"], items, _articulations(entry), lights)


def _articulations(entry: Mapping[str, Any]) -> tuple[Placement, ...]:
    x, z, *turn_deg = entry["door"]
    return (
        *_kitchen(*entry["kitchen"]),
        # The room door extends 0.92 m from its hinge to +z and swings to -x.
        Placement("door2", (x, 2.08, z), math.radians(*turn_deg or [0.0])),
        _standing("cabinet", 0.05, *entry["cabinet"]),
        _standing("chestOfDrawers_01", 0.0, *entry["chest"]),
    )


def _standing(template: str, y: float, x: float, z: float, facing: str) -> Placement:
    return Placement(template, (x, y, z), yaw_rad(template, facing))


def _lamp(
    x: float, z: float, power: float, y: float = 2.45, color: Sequence[float] = (1.0, 0.93, 0.84)
) -> Light:
    return Light((x, y, z), power, _tuples(color))


def _row(kind: Any, row: Sequence[Any]) -> Any:
    options = row[-1] if isinstance(row[-1], dict) else {}
    return kind(*_tuples(row[:-1] if options else row), **options)


def _tuples(value: Any) -> Any:
    """Return lists, at any depth, as tuples."""
    if isinstance(value, dict):
        return {key: _tuples(inner) for key, inner in value.items()}
    return tuple(map(_tuples, value)) if isinstance(value, list | tuple) else value
