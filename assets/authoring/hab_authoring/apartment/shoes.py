"""Pairs of shoes: sections from heel to toe under one skin, on a sole."""

from dataclasses import dataclass

import numpy as np

from hab_authoring.apartment import outlines, shapes, solids
from hab_authoring.apartment.builder import Builder, finished
from hab_authoring.apartment.model import Array, Box, ObjectModel, Part

SECTIONS = 9
SHARES = np.linspace(0.005, 0.985, SECTIONS)  # heel to toe, along the sole


@dataclass(frozen=True, kw_only=True)
class Shoe:
    """One of a pair; it points along +z. Heights are above the floor."""

    length_m: float
    width_m: float
    ankle_m: float
    sole_m: float
    gap_m: float
    upper: str
    sole: str
    laces: str | None = None


RUNNER = Shoe(
    length_m=0.295,
    width_m=0.105,
    ankle_m=0.105,
    sole_m=0.028,
    gap_m=0.035,
    upper="wool_grey",
    sole="plastic_white",
    laces="label_orange",
)
SNEAKER = Shoe(
    length_m=0.285,
    width_m=0.102,
    ankle_m=0.100,
    sole_m=0.025,
    gap_m=0.040,
    upper="label_white",
    sole="plastic_white",
    laces="plastic_grey",
)
SLIPPER = Shoe(
    length_m=0.265,
    width_m=0.095,
    ankle_m=0.058,
    sole_m=0.016,
    gap_m=0.020,
    upper="bag_cloth",
    sole="label_brown",
)
BOOT = Shoe(
    length_m=0.290,
    width_m=0.105,
    ankle_m=0.148,
    sole_m=0.030,
    gap_m=0.045,
    upper="leather",
    sole="rubber",
    laces="label_yellow",
)


def build() -> list[ObjectModel]:
    """Return four pairs."""
    return [
        _pair("01", 0.78, RUNNER),
        _pair("02", 0.82, SNEAKER),
        _pair("03", 0.36, SLIPPER),
        _pair("04", 1.45, BOOT),
    ]


def _outline(shoe: Shoe) -> Array:
    """Return half widths (K, 2) of the sole as (z, half width), heel to toe."""
    shares = [
        (0.0, 0.26),
        (0.05, 0.36),
        (0.18, 0.40),
        (0.42, 0.37),
        (0.66, 0.48),
        (0.80, 0.49),
        (0.93, 0.36),
        (1.0, 0.20),
    ]
    return np.array([((s - 0.5) * shoe.length_m, w * shoe.width_m) for s, w in shares])


def _pair(number: str, mass_kg: float, shoe: Shoe) -> ObjectModel:
    make = Builder()
    for side in (-1.0, 1.0):
        _one(make, shoe, side * (shoe.width_m + shoe.gap_m) / 2)
    return finished(f"shoe_{number}", "shoe", mass_kg, make, 0.9)


def _one(make: Builder, shoe: Shoe, x: float) -> None:
    outline, low = _outline(shoe), shoe.sole_m
    ring = np.vstack([outline * [1, -1], outline[::-1]])
    layers = [
        np.stack([x + scale * ring[:, 1], np.full(len(ring), y), ring[:, 0]], axis=1)
        for y, scale in ((0.0, 0.96), (0.5 * low, 1.03), (low, 1.0))
    ]
    tops = _tops(shoe)
    make.see(outlines.loft(layers, shoe.sole), _upper(shoe, x, tops))
    opening = (x, float(tops[1]) - 0.004, -0.33 * shoe.length_m)
    radii = (0.26 * shoe.width_m, 0.008, 0.15 * shoe.length_m)
    make.see(shapes.sphere(opening, radii, "gap", 6, 14))
    _laces(make, shoe, x, tops)
    _collide(make, shoe, x, float(tops[5]))


def _tops(shoe: Shoe) -> Array:
    """Return the upper's height above the floor at each of its sections."""
    low, ankle = shoe.sole_m, shoe.ankle_m
    toe = low + 0.42 * (0.105 - low)
    shares = [0.0, 0.08, 0.30, 0.45, 0.62, 0.85, 1.0]
    heights = [0.92 * ankle, ankle, 0.96 * ankle, (ankle + toe) / 2, toe + 0.012, toe, low + 0.012]
    return np.interp(np.linspace(0, 1, SECTIONS), shares, heights)


def _upper(shoe: Shoe, x: float, tops: Array) -> Part:
    """Return the skin over the foot: half ellipses, drawn in around the ankle."""
    outline, low, turn = _outline(shoe), shoe.sole_m, np.linspace(0, np.pi, SECTIONS)
    skins = []
    for share, top in zip(SHARES, tops, strict=True):
        z = (share - 0.5) * shoe.length_m
        half = 0.94 * float(np.interp(z, outline[:, 0], outline[:, 1]))
        pinch = 1 - 0.25 * np.sin(turn) * float(share < 0.5)
        across, rise = half * np.cos(turn) * pinch + x, low + (top - low) * np.sin(turn) ** 0.6
        skins.append(np.stack([across, rise, np.full(SECTIONS, z)], axis=1))
    return outlines.loft(skins, shoe.upper)


def _laces(make: Builder, shoe: Shoe, x: float, tops: Array) -> None:
    if shoe.laces is None:
        return
    for share in (0.40, 0.47, 0.54):
        top = float(np.interp(share, SHARES, tops))
        place = (x, top - 0.001, (share - 0.5) * shoe.length_m)
        make.see(shapes.box(place, (0.5 * shoe.width_m, 0.006, 0.007), shoe.laces, 0.002))


def _collide(make: Builder, shoe: Shoe, x: float, toe: float) -> None:
    """Add the sole, the toe box and the ankle of one shoe."""
    half, wide = shoe.length_m / 2, shoe.width_m
    sole = [(x + s * w, z) for s in (1, -1) for z, w in _sole_corners(shoe)[::s]]
    make.convexes.append(solids.prism(sole, 0.0, shoe.sole_m))
    make.boxes.append(
        Box((x, (shoe.sole_m + toe) / 2, 0.24 * half), (0.78 * wide, toe - shoe.sole_m, 1.2 * half))
    )
    make.boxes.append(
        Box(
            (x, (shoe.sole_m + shoe.ankle_m) / 2, -0.66 * half),
            (0.66 * wide, shoe.ankle_m - shoe.sole_m, 0.60 * half),
        )
    )


def _sole_corners(shoe: Shoe) -> list[tuple[float, float]]:
    half, wide = shoe.length_m / 2, shoe.width_m
    return [
        (-half, 0.27 * wide),
        (-0.8 * half, 0.42 * wide),
        (0.55 * half, 0.49 * wide),
        (half, 0.22 * wide),
    ]
