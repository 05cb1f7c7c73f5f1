"""The vocabulary of layouts: items on floors and walls, kitchens in a row, and flats.

Scene frame: y up, floor at y = 0; north is +z, east is +x.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from hab_authoring.apartment.model import Light, ObjectModel, Placement, SceneModel, full_name
from hab_authoring.apartment.shell import FloorPlan

RUG_M = 0.012
"""How high a rug lies."""

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


def kitchen(wall: float, along: float, facing: str) -> tuple[Placement, ...]:
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


def door(x: float, z: float, yaw: float = 0.0) -> Placement:
    """Return the room door, which extends 0.92 m from its hinge to +z and swings to -x."""
    return Placement("door2", (x, 2.08, z), yaw)


def cabinet(x: float, z: float, facing: str) -> Placement:
    """Return the low cabinet with sliding doors."""
    return Placement("cabinet", (x, 0.05, z), yaw_rad("cabinet", facing))


def chest(x: float, z: float, facing: str) -> Placement:
    """Return the chest of drawers."""
    return Placement("chestOfDrawers_01", (x, 0.0, z), yaw_rad("chestOfDrawers_01", facing))


def lamps(*places: tuple[float, float, float]) -> tuple[Light, ...]:
    """Return warm ceiling lights from (x, z, intensity)."""
    return tuple(Light((x, 2.45, z), power, (1.0, 0.93, 0.84)) for x, z, power in places)
