"""Finishes a model that was built on a floor at y = 0: moves its origin to its centre of mass."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hab_authoring.apartment import shapes, solids
from hab_authoring.apartment.builder import Builder
from hab_authoring.apartment.model import ObjectModel, Receptacle, Vec3

FRICTION = 0.7
PREFIX = "frl_apartment_"


def finished(
    name: str,
    category: str,
    mass_kg: float,
    make: Builder,
    friction: float = FRICTION,
    receptacles: Sequence[Receptacle] = (),
) -> ObjectModel:
    """Return the model, shifted so that the centroid of its collision shapes is the origin."""
    pieces = make.solids()
    shift = -np.round(solids.centroid(pieces), 4)
    return ObjectModel(
        PREFIX + name,
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
