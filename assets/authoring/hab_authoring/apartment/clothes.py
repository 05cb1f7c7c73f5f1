"""A coat and a scarf on hooks, the handbag, the beanbag, the cushions, and pairs of shoes.

A shoe consists of sections from heel to toe under one skin, on a sole.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from hab_authoring.apartment import outlines, shapes, solids
from hab_authoring.apartment.builder import Builder, finished
from hab_authoring.apartment.model import Array, Box, Convex, ObjectModel, Part, Vec3

CLOTH_FRICTION = 0.9


def build() -> list[ObjectModel]:
    """Return all of them; the coat and the scarf hang with their back at -z."""
    return [
        _coat(),
        _scarf(),
        _handbag(),
        _beanbag(),
        *_cushions(),
        _pair("01", 0.78, RUNNER),
        _pair("02", 0.82, SNEAKER),
        _pair("03", 0.36, SLIPPER),
        _pair("04", 1.45, BOOT),
    ]


def _ellipse(center: Vec3, half_x: float, half_z: float, ripple: float = 0.0) -> Array:
    t = np.linspace(0, 2 * np.pi, 25)[:-1]
    wide = 1 + ripple * np.cos(8 * t)
    x, z = half_x * np.cos(t) * wide, half_z * np.sin(t) * wide
    return np.stack([x, 0 * t, z], axis=1) + np.asarray(center)


def _coat() -> ObjectModel:
    """Return a coat on a hook; its loop is at the top."""
    make = Builder()
    levels = (
        (0.00, 0.27, 0.070, 0.14), (0.10, 0.265, 0.068, 0.12), (0.35, 0.235, 0.062, 0.06),
        (0.55, 0.225, 0.062, 0.02), (0.74, 0.220, 0.060, 0.0), (0.82, 0.165, 0.050, 0.0),
        (0.86, 0.075, 0.042, 0.0),
    )  # fmt: skip
    make.see(
        outlines.loft([_ellipse((0.0, y, 0.075), a, b, r) for y, a, b, r in levels], "coat_navy")
    )
    for side in (-1.0, 1.0):
        arm = [
            (0.18, 0.79, 0.055),
            (0.245, 0.70, 0.060),
            (0.285, 0.45, 0.055),
            (0.295, 0.24, 0.050),
        ]
        make.see(
            outlines.loft([_ellipse((side * x, y, 0.080), w, w) for x, y, w in arm], "coat_navy")
        )
    for side in (-1.0, 1.0):
        flap = shapes.soft_box((side * 0.05, 0.815, 0.118), (0.07, 0.12, 0.018), "coat_navy", 0.008)
        make.see(flap)
    for y in (0.30, 0.43, 0.56, 0.69):
        make.see(shapes.cylinder((0.015, y, 0.137), 0.011, 0.006, "black_plastic", "z", 12, 0.002))
    loop = [(-0.012, 0.86, 0.03), (-0.012, 0.895, 0.02), (0.012, 0.895, 0.02), (0.012, 0.86, 0.03)]
    make.see(shapes.tube(loop, 0.004, "gap", 6))
    make.boxes += [
        Box((0.0, 0.37, 0.075), (0.48, 0.74, 0.13)),
        Box((0.0, 0.79, 0.075), (0.32, 0.12, 0.11)),
        Box((-0.285, 0.48, 0.080), (0.10, 0.56, 0.11)),
        Box((0.285, 0.48, 0.080), (0.10, 0.56, 0.11)),
        Box((0.0, 0.87, 0.05), (0.05, 0.05, 0.06)),
    ]
    return finished("cloth_01", "cloth", 1.6, make, CLOTH_FRICTION)


def _scarf() -> ObjectModel:
    """Return a scarf laid over a hook: two ends of unequal length, with fringes."""
    make = Builder()
    for x, low, tilt in ((-0.075, 0.0, 0.05), (0.075, 0.14, -0.06)):
        sections = [
            _ellipse(
                (x + tilt * (1 - t), low + (0.86 - low) * t, 0.03),
                0.085 - 0.045 * t,
                0.016 + 0.008 * t,
                0.05,
            )
            for t in np.linspace(0, 1, 6)
        ]
        make.see(outlines.loft(sections, "rust_cloth"))
        for k in range(7):
            end = (x + tilt + 0.024 * (k - 3), low - 0.03, 0.03)
            make.see(shapes.box(end, (0.006, 0.066, 0.006), "label_cream", 0.0))
    make.see(shapes.sphere((0.0, 0.865, 0.03), (0.10, 0.045, 0.03), "rust_cloth", 8, 14))
    make.boxes += [
        Box((-0.055, 0.425, 0.03), (0.12, 0.97, 0.05)),
        Box((0.06, 0.49, 0.03), (0.115, 0.84, 0.05)),
    ]
    return finished("cloth_02", "cloth", 0.35, make, CLOTH_FRICTION)


def _handbag() -> ObjectModel:
    """Return a leather bag that stands, with two upright straps."""
    make = Builder()
    levels = (
        (0.000, 0.138, 0.070), (0.008, 0.148, 0.078), (0.10, 0.152, 0.076), (0.20, 0.140, 0.055),
        (0.245, 0.128, 0.034), (0.25, 0.124, 0.028),
    )  # fmt: skip
    sections = [
        np.array([(x, y, z) for x, z in outlines.rounded_rectangle(a, b, 0.6 * b, 5)])
        for y, a, b in levels
    ]
    make.see(outlines.loft(sections, "leather"))
    for z in (-0.026, 0.026):
        strap = [
            (0.075 * math.cos(a), 0.225 + 0.145 * math.sin(a), z * (1 - 0.4 * math.sin(a)))
            for a in np.linspace(0, math.pi, 10)
        ]
        make.see(shapes.tube(strap, 0.006, "leather", 6))
    make.see(shapes.box((0.0, 0.175, 0.063), (0.045, 0.022, 0.006), "brass", 0.002))
    low, high = sections[1].copy(), sections[4]
    low[:, 1] = 0.0
    make.convexes.append(solids.hull(np.vstack([low, sections[2], high])))
    make.boxes.append(Box((0.0, 0.305, 0.0), (0.15, 0.125, 0.045)))
    return finished("handbag", "handbag", 1.1, make, CLOTH_FRICTION)


def _beanbag() -> ObjectModel:
    """Return a sagging bag: a turned pear with a seam ring and a knot."""
    make, floor = Builder(), -0.333
    profile = [
        (0.0, floor),
        (0.34, floor),
        (0.44, floor + 0.03),
        (0.495, floor + 0.10),
        (0.51, floor + 0.18),
        (0.49, floor + 0.28),
        (0.43, floor + 0.38),
        (0.34, floor + 0.47),
        (0.24, floor + 0.545),
        (0.15, floor + 0.60),
        (0.07, floor + 0.63),
        (0.0, floor + 0.64),
    ]
    make.see(_puckered(shapes.lathe([profile], "bag_cloth", 36), floor))
    make.see(
        shapes.cylinder((0.0, floor + 0.655, 0.0), 0.035, 0.05, "bag_cloth", top_radius_m=0.05)
    )
    make.convexes += [
        solids.frustum(0.40, 0.51, floor, floor + 0.15, 16),
        solids.frustum(0.51, 0.42, floor + 0.15, floor + 0.39, 16),
        solids.frustum(0.42, 0.10, floor + 0.39, floor + 0.62, 16),
    ]
    return ObjectModel("frl_apartment_beanbag", "beanbag", 11.0, make.parts, make.solids())


def _puckered(part: Part, floor: float) -> Part:
    """Press six shallow folds into a turned bag, none at its foot."""
    x, y, z = part.positions.T
    angle, share = np.arctan2(z, x), np.clip((y - floor) / 0.3, 0, 1)
    scale = 1 - 0.07 * share * (0.5 + 0.5 * np.cos(6 * angle)) - 0.05 * share * np.cos(angle - 0.6)
    points = np.stack([x * scale, y - 0.04 * share * (x / 0.5), z * scale], axis=1)
    return shapes.smoothed(replace(part, positions=points))


def _cushions() -> list[ObjectModel]:
    out = []
    for number, cloth in (("01", "rust_cloth"), ("03", "cream_cloth")):
        part = shapes.soft_box((0.0, 0.0, 0.0), (0.42, 0.40, 0.09), cloth, 0.044, 0.03, steps=3)
        name = f"frl_apartment_cushion_{number}"
        out.append(ObjectModel(name, "cushion", 0.3, [part], [_pillow()], friction=0.8))
    return out


def _pillow() -> Convex:
    """Return the cushion's hull: a flat octagon standing on its edge."""
    slab = solids.prism(
        [
            (-0.21, -0.15),
            (-0.15, -0.20),
            (0.15, -0.20),
            (0.21, -0.15),
            (0.21, 0.15),
            (0.15, 0.20),
            (-0.15, 0.20),
            (-0.21, 0.15),
        ],
        -0.065,
        0.065,
    )
    return Convex(slab.vertices[:, [0, 2, 1]], slab.faces[:, ::-1])


SECTIONS = 9
SHARES = np.linspace(0.005, 0.985, SECTIONS)  # heel to toe, along the sole


@dataclass(frozen=True)
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


RUNNER = Shoe(0.295, 0.105, 0.105, 0.028, 0.035, "wool_grey", "plastic_white", "label_orange")
SNEAKER = Shoe(0.285, 0.102, 0.100, 0.025, 0.040, "label_white", "plastic_white", "plastic_grey")
SLIPPER = Shoe(0.265, 0.095, 0.058, 0.016, 0.020, "bag_cloth", "label_brown")
BOOT = Shoe(0.290, 0.105, 0.148, 0.030, 0.045, "leather", "rubber", "label_yellow")


def _outline(shoe: Shoe) -> Array:
    """Return half widths (K, 2) of the sole as (z, half width), heel to toe."""
    shares = [(0.0, 0.26), (0.05, 0.36), (0.18, 0.40), (0.42, 0.37)]
    shares += [(0.66, 0.48), (0.80, 0.49), (0.93, 0.36), (1.0, 0.20)]
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
