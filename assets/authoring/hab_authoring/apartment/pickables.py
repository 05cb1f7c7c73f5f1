"""Pickable objects with the published sizes and masses of the YCB object set.

Labels are fictional. Objects stand upright along +y, with the origin at the centre of mass.
"""

import math
from itertools import pairwise

import numpy as np

from hab_authoring.apartment import shapes, solids
from hab_authoring.apartment.builder import Builder
from hab_authoring.apartment.model import Box, Convex, ObjectModel, Part

FRICTION = 0.8
Chain = list[tuple[float, float]]


def build() -> list[ObjectModel]:
    """Return those that `catalogue` lacks."""
    blue, cream = "label_blue", "label_cream"
    return [
        _can("002_master_chef_can", 0.414, 0.102, 0.139, blue, cream, lid="plastic_lid"),
        _carton("003_cracker_box", 0.411, (0.158, 0.210, 0.060), "label_red", "label_yellow"),
        _carton("004_sugar_box", 0.514, (0.089, 0.175, 0.038), "label_yellow", "label_white"),
        _can("005_tomato_soup_can", 0.349, 0.066, 0.101, "label_red", "label_white"),
        _can("007_tuna_fish_can", 0.171, 0.085, 0.033, "label_teal", "label_yellow"),
        _carton("008_pudding_box", 0.187, (0.110, 0.089, 0.035), "label_brown", "label_cream"),
        _carton("009_gelatin_box", 0.097, (0.085, 0.073, 0.028), "label_pink", "label_white"),
        _apple(),
        _bowl(),
        _mug(),
    ]


def _item(name: str, mass_kg: float, parts: list[Part], hulls: list[Convex]) -> ObjectModel:
    return ObjectModel(name, name[4:], mass_kg, parts, hulls, friction=FRICTION)


def _can(
    name: str,
    mass_kg: float,
    diameter: float,
    height: float,
    label: str,
    band: str,
    lid: str = "can_metal",
) -> ObjectModel:
    """Return a tin: rolled rims, a sunk lid, and a paper label with a band and a round badge."""
    r, h, rim = diameter / 2, height / 2, 0.0022
    body = r - 0.0012
    edge = min(0.006, height * 0.12)
    chains: list[tuple[Chain, str]] = [
        ([(0.0, -h + 0.002), (body - rim, -h + 0.002), (body - rim, -h)], "can_metal"),
        (
            [
                (body - rim, -h),
                (r - 0.0004, -h),
                (r, -h + rim / 2),
                (r, -h + rim),
                (body, -h + 2 * rim),
            ],
            "can_metal",
        ),
        ([(body, -h + 2 * rim), (body, -h + edge)], "can_metal"),
        ([(body, -h + edge), (body, -h + 0.32 * height)], label),
        ([(body, -h + 0.32 * height), (body, -h + 0.40 * height)], band),
        ([(body, -h + 0.40 * height), (body, h - edge)], label),
        ([(body, h - edge), (body, h - 2 * rim)], "can_metal"),
        (
            [(body, h - 2 * rim), (r, h - rim), (r, h - rim / 2), (r - 0.0004, h), (body - rim, h)],
            lid,
        ),
        ([(body - rim, h), (body - rim, h - 0.003), (0.0, h - 0.003)], lid),
    ]
    parts = [shapes.lathe([chain], material, 28) for chain, material in chains]
    parts += _badge(body, 0.62 * height - h, 0.20 * height, band)
    return _item(name, mass_kg, parts, [solids.frustum(r, r, -h, h, 20)])


def _badge(radius: float, y: float, half_height: float, material: str) -> list[Part]:
    """Return two round badges wrapped on a can's label, in rings so that they follow its curve."""
    out, lift = [], radius + 0.0004
    turn = np.linspace(0, 2 * math.pi, 19)
    for middle in (0.0, math.pi):
        reach = np.array([0.0, 0.34, 0.67, 1.0])[:, None] * half_height
        angle = (middle + reach * np.cos(turn) / radius).ravel()
        height = (y + reach * np.sin(turn)).ravel()
        normal = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1)
        points = normal * lift + np.stack([0 * height, height, 0 * height], axis=1)
        n = len(turn)
        faces = [
            [a, a + n, a + n + 1] if k else [a, a + n + 1, a + 1]
            for row in range(3)
            for a in range(row * n, row * n + n - 1)
            for k in (0, 1)
        ]
        part = Part(points, normal, points[:, :2], np.array(faces), material)
        out.append(shapes.oriented(part))
    return out


def _carton(
    name: str, mass_kg: float, size: tuple[float, float, float], ground: str, accent: str
) -> ObjectModel:
    """Return a cardboard box with a printed panel, a stripe and a pictured bowl of circles."""
    w, h, d = size
    make, lift = Builder(), 0.0004
    make.box((0.0, 0.0, 0.0), size, ground, 0.0015)
    for face in (-1.0, 1.0):
        z = face * d / 2
        make.see(shapes.box((0.0, 0.26 * h, z), (0.84 * w, 0.26 * h, lift), accent, 0.0))
        make.see(shapes.box((0.0, 0.26 * h, z), (0.60 * w, 0.07 * h, 3 * lift), ground, 0.0))
        make.see(shapes.box((0.0, -0.40 * h, z), (w * 0.98, 0.06 * h, lift), accent, 0.0))
        for x, y, r in ((0.0, -0.15, 0.17), (-0.2, -0.2, 0.09), (0.21, -0.18, 0.10)):
            make.see(
                shapes.cylinder(
                    (x * w, y * h, z), r * min(w, h), lift * 2, "label_cream", "z", 20, 0.0001
                )
            )
        make.see(
            shapes.cylinder(
                (0.0, -0.15 * h, z), 0.11 * min(w, h), lift * 4, "label_brown", "z", 18, 0.0001
            )
        )
        make.see(shapes.box((face * w / 2, 0.1 * h, 0.0), (lift, 0.5 * h, 0.7 * d), accent, 0.0))
    make.see(shapes.box((0.0, h / 2, 0.0), (0.98 * w, lift, 0.004), "label_brown", 0.0))
    return _item(name, mass_kg, make.parts, make.solids())


def _apple() -> ObjectModel:
    r = 0.0375
    profile: Chain = []
    for k in range(17):
        t = -math.pi / 2 + math.pi * k / 16
        dip = 0.010 * math.exp(-(((math.pi / 2 - t) / 0.42) ** 2)) + 0.005 * math.exp(
            -(((math.pi / 2 + t) / 0.4) ** 2)
        )
        wide = r * math.cos(t) * (1.0 + 0.05 * math.sin(t))
        profile.append(
            (max(wide, 0.0) * 0.985, r * 0.95 * math.sin(t) - math.copysign(dip, math.sin(t)))
        )
    skin = shapes.lathe([profile], "apple_skin", 24)
    stalk = shapes.tube(
        [(0.0, 0.022, 0.0), (0.001, 0.032, 0.0), (0.004, 0.041, 0.001)], 0.0014, "stalk", 6
    )
    hull = solids.ball((r, r * 0.92, r), 5, 10)
    return _item("013_apple", 0.068, [skin, stalk], [hull])


def _bowl() -> ObjectModel:
    """Return the bowl; its wall is a stack of ring pieces, its origin the solid's centroid."""
    profile = [(0.030, 0.0), (0.036, 0.005), (0.0545, 0.018), (0.0700, 0.034), (0.0795, 0.053)]
    inner = [(0.0760, 0.053), (0.0660, 0.0355), (0.0505, 0.021), (0.0330, 0.0095), (0.0, 0.0085)]
    pieces = [solids.frustum(0.036, 0.044, 0.0, 0.009, 16)]
    levels = (0.009, 0.030, 0.053)
    for low, high in pairwise(levels):
        pieces += solids.ring(
            _radii(profile, inner, low), _radii(profile, inner, high), (low, high), 12
        )
    center = round(float(solids.centroid(pieces)[1]), 5)
    chains = [
        [(0.0, 0.002), (0.028, 0.002), (0.030, 0.0)],
        profile,
        [profile[-1], (0.0782, 0.0542), inner[0]],
        inner,
    ]
    parts = [
        shapes.lathe([[(r, y - center) for r, y in chain]], "bowl_red", 32) for chain in chains
    ]
    return _item("024_bowl", 0.147, parts, [solids.moved(p, (0.0, -center, 0.0)) for p in pieces])


def _radii(outside: Chain, inside: Chain, height: float) -> tuple[float, float]:
    out = float(np.interp(height, [y for _, y in outside], [r for r, _ in outside]))
    flipped = inside[::-1]
    into = float(np.interp(height, [y for _, y in flipped], [r for r, _ in flipped]))
    return min(into, out - 0.003), out


MUG_RADIUS_M, MUG_HEIGHT_M, MUG_WALL_M = 0.040, 0.082, 0.0035
# Low and high corner of the handle's three pieces, in x and y.
MUG_HANDLE = (
    ((0.038, 0.060), (0.062, 0.070)),
    ((0.060, 0.022), (0.070, 0.064)),
    ((0.038, 0.013), (0.062, 0.024)),
)


def _mug() -> ObjectModel:
    """Return the mug, its handle towards +x."""
    r, wall = MUG_RADIUS_M, MUG_WALL_M
    pieces = [solids.frustum(r - 0.002, r, 0.0, 0.006, 16)]
    pieces += solids.ring((r - wall, r), (r - wall, r), (0.006, MUG_HEIGHT_M), 12)
    center = round(float(solids.centroid(pieces)[1]), 5)
    for (x0, y0), (x1, y1) in MUG_HANDLE:
        middle = ((x0 + x1) / 2, (y0 + y1) / 2, 0.0)
        pieces.append(solids.from_box(Box(middle, (x1 - x0, y1 - y0, 0.010))))
    lowered = [shapes.moved(p, (0.0, -center, 0.0)) for p in _mug_parts()]
    hulls = [solids.moved(p, (0.0, -center, 0.0)) for p in pieces]
    return _item("025_mug", 0.118, lowered, hulls)


def _mug_parts() -> list[Part]:
    r, h, inner = MUG_RADIUS_M, MUG_HEIGHT_M, MUG_RADIUS_M - MUG_WALL_M
    foot: Chain = [(0.0, 0.002), (0.030, 0.002), (0.032, 0.0), (r - 0.003, 0.0)]
    side: Chain = [foot[-1], (r - 0.0008, 0.001), (r, 0.004), (r, h - 0.002)]
    side += [(r - 0.0008, h), (r - 0.002, h)]
    inside: Chain = [side[-1], (inner, h - 0.001), (inner, 0.010), (inner - 0.004, 0.006)]
    inside.append((0.0, 0.006))
    loop = [(r - 0.002, 0.066), (0.052, 0.068), (0.062, 0.062), (0.067, 0.050)]
    loop += [(0.066, 0.036), (0.059, 0.024), (0.050, 0.017), (r - 0.002, 0.015)]
    return [
        shapes.lathe([foot, side], "mug_glaze", 30),
        shapes.lathe([inside], "mug_inside", 30),
        shapes.tube([(x, y, 0.0) for x, y in loop], 0.0048, "mug_glaze", 10),
    ]
