"""Builder of a model's visual and collision geometry, on a floor at y = 0 until it is finished."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hab_authoring.apartment import shapes, solids
from hab_authoring.apartment.model import (
    Box,
    Convex,
    ObjectModel,
    Part,
    Receptacle,
    Vec3,
    full_name,
)

BAR_RADIUS_M = 0.007
POST_M = 0.010
FRICTION = 0.7


@dataclass
class Builder:
    """A model under construction; `box` adds visual and collision geometry in one call."""

    parts: list[Part] = field(default_factory=list)
    boxes: list[Box] = field(default_factory=list)
    convexes: list[Convex] = field(default_factory=list)

    def box(
        self, center: Vec3, size: Vec3, material: str, bevel_m: float = 0.004, solid: bool = True
    ) -> None:
        """Add a bevelled box."""
        self.parts.append(shapes.box(center, size, material, bevel_m))
        if solid:
            self.boxes.append(Box(center, size))

    def span(
        self,
        low: Vec3,
        high: Vec3,
        material: str,
        bevel_m: float = 0.004,
        solid: bool = True,
    ) -> None:
        """Add a bevelled box given by two opposite corners."""
        (x0, y0, z0), (x1, y1, z1) = low, high
        center = ((x0 + x1) / 2, (y0 + y1) / 2, (z0 + z1) / 2)
        self.box(center, (x1 - x0, y1 - y0, z1 - z0), material, bevel_m, solid)

    def soft(
        self,
        center: Vec3,
        size: Vec3,
        material: str,
        radius_m: float,
        bulge_m: float = 0.0,
        solid: bool = True,
    ) -> None:
        """Add a rounded, upholstered box."""
        self.parts.append(shapes.soft_box(center, size, material, radius_m, bulge_m))
        if solid:
            self.boxes.append(Box(center, size))

    def post(
        self, center: Vec3, radius_m: float, height_m: float, material: str, solid: bool = True
    ) -> None:
        """Add an upright round post."""
        self.parts.append(shapes.cylinder(center, radius_m, height_m, material, sides=14))
        if solid:
            low, high = center[1] - height_m / 2, center[1] + height_m / 2
            self.convexes.append(
                solids.frustum(radius_m, radius_m, low, high, 10, (center[0], center[2]))
            )

    def see(self, *parts: Part) -> None:
        """Add visual surfaces without collision geometry."""
        self.parts.extend(parts)

    def bar_handle(
        self, center: Vec3, axis: str, length_m: float, reach_m: float, material: str
    ) -> None:
        """Add a round bar on two posts, mounted on a face `reach_m` behind it along -x."""
        bar = shapes.cylinder(center, BAR_RADIUS_M, length_m, material, axis, 12, 0.0015)
        index = shapes.AXES[axis]
        size = [2 * BAR_RADIUS_M] * 3
        size[index] = length_m
        self.parts.append(bar)
        self.boxes.append(Box(center, (size[0], size[1], size[2])))
        for side in (-1.0, 1.0):
            foot = list(center)
            foot[index] += side * (length_m / 2 - 0.02)
            foot[0] -= reach_m / 2
            place = (foot[0], foot[1], foot[2])
            self.parts.append(
                shapes.cylinder(place, POST_M / 2, reach_m, material, "x", 10, 0.0005)
            )
            self.boxes.append(Box(place, (reach_m, POST_M, POST_M)))

    def solids(self) -> list[Convex]:
        """Return all collision pieces as convex meshes."""
        return [solids.from_box(box) for box in self.boxes] + self.convexes


def finished(
    name: str,
    category: str,
    mass_kg: float,
    make: Builder,
    friction: float = FRICTION,
    receptacles: Sequence[Receptacle] = (),
    *,
    centred: bool = True,
) -> ObjectModel:
    """Return the model; `centred` shifts the centroid of its collision shapes to the origin."""
    pieces = make.solids()
    shift = -np.round(solids.centroid(pieces), 4) if centred else np.zeros(3)
    return ObjectModel(
        full_name(name),
        category,
        mass_kg,
        [shapes.moved(part, shift) for part in make.parts],
        [solids.moved(piece, shift) for piece in pieces],
        [replace(r, center=_sum(r.center, shift)) for r in receptacles],
        friction,
    )


def free_box(name: str, bottom: Vec3, half: Vec3) -> Receptacle:
    """Return a receptacle from the centre of its bottom face."""
    return Receptacle(f"receptacle_aabb_{name}", (bottom[0], bottom[1] + half[1], bottom[2]), half)


def _sum(a: Vec3, b: np.ndarray) -> Vec3:
    x, y, z = (float(v) for v in np.asarray(a) + b)
    return (x, y, z)
