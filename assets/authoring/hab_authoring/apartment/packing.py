"""Fills a furnished flat with loose objects on suitable surfaces, without contacts.

Overlap is tested with the axis-aligned boxes of collision pieces, which is conservative.
"""

import math
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch

import numpy as np

from hab_authoring.apartment.layouts import Layout, Thing, feet_m, front_rad, placed
from hab_authoring.apartment.model import (
    Array,
    Articulation,
    ObjectModel,
    Placement,
    SceneModel,
    full_name,
)

GAP_M = 0.001  # loose things start this far above what carries them
APART_M = 0.003
TRIES = 400
FIXED = ("rug", "mat")


@dataclass(frozen=True)
class Rectangle:
    """A level rectangle in the frame of its support."""

    name: str
    middle: tuple[float, float, float]
    half_x: float
    half_z: float


# Surfaces that are no receptacles, by template.
MORE_SURFACES = {
    "sofa": (
        Rectangle("back", (0.0, 0.0423, 0.02), 0.30, 0.10),
        Rectangle("end_left", (-0.66, 0.0423, -0.16), 0.23, 0.22),
        Rectangle("end_right", (0.66, 0.0423, -0.16), 0.23, 0.22),
    ),
    "apartment_bed": (Rectangle("cover", (0.0, 0.20, -0.18), 0.72, 0.66),),
    "table_04": (Rectangle("top", (0.0, 0.066, 0.0), 0.22, 0.22),),
    "stool_02": (Rectangle("seat", (0.0, 0.1275, 0.0), 0.15, 0.15),),
    "cabinet": (Rectangle("top", (-0.038, 0.758, -0.005), 0.76, 0.20),),
    "chestOfDrawers_01": (Rectangle("top", (0.01, 1.255, 0.0), 0.15, 0.42),),
    "floor": (Rectangle("bedroom", (4.12, 0.0, -1.30), 0.29, 0.48),),
}
# Boards that carry things deeper than their receptacles say: half sizes.
WIDER = {"rack_01": (0.37, 0.152)}


@dataclass(frozen=True)
class Surface:
    """A rectangle in the scene; `front_rad` is the heading of its front."""

    name: str
    middle: Array  # (3,)
    turn_rad: float
    half_x: float
    half_z: float
    front_rad: float


class Packer:
    """Places objects one after another in a flat, and records the occupied space."""

    def __init__(
        self,
        rng: np.random.Generator,
        models: Mapping[str, ObjectModel],
        feet: Mapping[str, float],
    ) -> None:
        self.rng, self.models, self.feet = rng, models, feet
        self.taken = np.zeros((0, 2, 3))
        self.surfaces: list[Surface] = []

    def add(self, placement: Placement, short: str) -> None:
        """Record a placed object and its surfaces."""
        model = self.models[placement.template]
        self.taken = np.concatenate([self.taken, self._boxes(placement)])
        rectangles = [*MORE_SURFACES.get(short, ()), *_receptacles(model)]
        self._offer(placement, short, rectangles)

    def add_surfaces(self, placement: Placement, articulation: Articulation | None) -> None:
        """Record the surfaces of articulated furniture or of the floor."""
        rectangles = list(MORE_SURFACES.get(placement.template, ()))
        if articulation is not None and placement.template == "kitchen_counter":
            rectangles += _receptacles(articulation)
        self._offer(placement, placement.template, rectangles)

    def put(self, thing: Thing) -> list[Placement]:
        """Place one object or stack.

        Raises:
            ValueError: No suitable surface has room.
        """
        names = [full_name(name) for name in thing.template.split("+")]
        fits = [s for s in self.surfaces if any(fnmatch(s.name, p) for p in thing.places)]
        for index in self.rng.permutation(len(fits)):
            for _ in range(TRIES):
                stack = self._try(thing, names, fits[index])
                if stack:
                    for placement, short in zip(stack, thing.template.split("+"), strict=True):
                        self.add(placement, short)
                    return stack
        raise ValueError(f"no room for {thing.template}; it may lie on {[s.name for s in fits]}")

    def _try(self, thing: Thing, names: list[str], surface: Surface) -> list[Placement]:
        """Return a stack at a random position on the surface, empty if that is not free."""
        yaw = surface.front_rad - front_rad(thing.template)
        yaw += float(self.rng.uniform(-1.0, 1.0)) * thing.turn_rad
        shape = self._outline(names, yaw - surface.turn_rad)
        low, high = shape.min(axis=0), shape.max(axis=0)
        half = np.array([surface.half_x, surface.half_z])
        if (high - low > 2 * half).any():
            return []
        spot = self.rng.uniform(-half - low, half - high)
        c, s = math.cos(surface.turn_rad), math.sin(surface.turn_rad)
        x = surface.middle[0] + c * spot[0] + s * spot[1]
        z = surface.middle[2] - s * spot[0] + c * spot[1]
        stack, level = [], float(surface.middle[1])
        for name in names:
            y = level + GAP_M + self.feet[name]
            stack.append(
                Placement(name, (round(x, 4), round(y, 5), round(z, 4)), round(yaw, 4), 0.0, True)
            )
            level = y + float(max(s.vertices[:, 1].max() for s in self.models[name].solids))
        boxes = np.concatenate([self._boxes(p) for p in stack])
        return [] if self._hits(boxes) else stack

    def _outline(self, names: Sequence[str], yaw: float) -> Array:
        """Return the corners (K, 2) of a stack seen from above, turned by `yaw`."""
        points = np.vstack([s.vertices for name in names for s in self.models[name].solids])
        return _turned(points, yaw)[:, [0, 2]]

    def _boxes(self, placement: Placement) -> Array:
        """Return the bounding boxes (S, 2, 3) of the collision pieces of a placed object."""
        out = []
        for solid in self.models[placement.template].solids:
            points = _turned(solid.vertices, placement.yaw_rad) + placement.translation
            out.append([points.min(axis=0), points.max(axis=0)])
        return np.array(out)

    def _hits(self, boxes: Array) -> bool:
        side = np.array([APART_M, 0.0, APART_M])
        low = np.maximum(boxes[:, None, 0] - side, self.taken[None, :, 0])
        high = np.minimum(boxes[:, None, 1] + side, self.taken[None, :, 1])
        return bool((high > low).all(axis=2).any())

    def _offer(self, placement: Placement, short: str, rectangles: Iterable[Rectangle]) -> None:
        turn = placement.yaw_rad
        for found in rectangles:
            middle = _turned(np.array([found.middle]), turn)[0] + placement.translation
            half_x, half_z = WIDER.get(short, (found.half_x, found.half_z))
            name, front = f"{short}/{found.name}", turn + front_rad(short)
            self.surfaces.append(Surface(name, middle, turn, half_x, half_z, front))


def furnished(
    layout: Layout,
    things: Iterable[Thing],
    models: Iterable[ObjectModel],
    jointed: Iterable[Articulation],
) -> SceneModel:
    """Return a layout with its furniture loose and its surfaces filled, seeded by its name."""
    seed = zlib.crc32(layout.name.encode())
    feet = feet_m(models)
    packer = Packer(np.random.default_rng(seed), {m.name: m for m in models}, feet)
    articulations = {a.name: a for a in jointed}
    objects = []
    for item in layout.items:
        fixed = item.y_m is not None or item.template.startswith(FIXED)
        found = placed(item, feet, dynamic=not fixed)
        if not fixed:
            x, y, z = found.translation
            found = Placement(found.template, (x, y + GAP_M, z), found.yaw_rad, 0.0, True)
        packer.add(found, item.template)
        objects.append(found)
    for placement in layout.articulations:
        packer.add_surfaces(placement, articulations[placement.template])
    packer.add_surfaces(Placement("floor", (0.0, 0.0, 0.0)), None)
    for thing in things:
        for _ in range(thing.count):
            objects += packer.put(thing)
    return SceneModel(
        layout.name, layout.plan.name, layout.lighting, objects, list(layout.articulations)
    )


def _receptacles(model: ObjectModel | Articulation) -> Iterator[Rectangle]:
    for box in model.receptacles:
        if box.up == (0.0, 1.0, 0.0):
            x, y, z = box.center
            half_x, half_y, half_z = box.half_extents
            name = box.name.removeprefix("receptacle_aabb_")
            yield Rectangle(name, (x, y - half_y, z), half_x, half_z)


def _turned(points: Array, yaw: float) -> Array:
    c, s = math.cos(yaw), math.sin(yaw)
    return points @ np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
