"""Sofa, chairs, stool, beanbag, bed and cushions. Fronts face -z."""

import math
from dataclasses import replace

import numpy as np

from hab_authoring.apartment import shapes, solids
from hab_authoring.apartment.builder import Builder, finished
from hab_authoring.apartment.model import Box, Convex, ObjectModel, Part, Receptacle


def build() -> list[ObjectModel]:
    """Return everything to sit or lie on."""
    return [
        _sofa(),
        _armchair(),
        _dining_chair(),
        _padded_chair(),
        _stool(),
        _beanbag(),
        _bed(),
        *_cushions(),
    ]


def _sofa() -> ObjectModel:
    make, cloth, seat = Builder(), "sofa_cloth", 0.0423
    make.soft((0.0, -0.215, -0.02), (2.10, 0.19, 0.86), cloth, 0.02)
    for side in (-1.0, 1.0):
        make.soft((side * 0.99, -0.07, -0.055), (0.16, 0.50, 0.95), cloth, 0.05)
        middle = side * 0.4535
        low = (middle, seat - 0.083, -0.18)
        make.soft(low, (0.903, 0.166, 0.70), cloth, 0.05, 0.006, solid=False)
        make.soft((middle, 0.215, 0.205), (0.890, 0.37, 0.15), cloth, 0.07, 0.02)
    # One box under both seat cushions, so that objects do not fall into the seam.
    make.boxes.append(Box((0.0, seat - 0.083, -0.18), (1.80, 0.166, 0.70)))
    make.soft((0.0, 0.06, 0.345), (1.75, 0.66, 0.15), cloth, 0.04)
    for x in (-0.98, 0.98):
        for z in (-0.42, 0.34):
            make.post((x, -0.3515, z), 0.024, 0.083, "walnut")
    free = Receptacle(
        "receptacle_aabb_Sofa_frl_apartment_sofa", (0.0, seat + 0.133, -0.20), (0.46, 0.133, 0.26)
    )
    return ObjectModel("frl_apartment_sofa", "sofa", 68.0, make.parts, make.solids(), [free])


def _armchair() -> ObjectModel:
    make, cloth, seat = Builder(), "chair_cloth", 0.0417
    make.soft((0.0, -0.185, 0.0), (0.74, 0.15, 0.66), cloth, 0.04)
    make.soft((0.0, seat - 0.08, -0.10), (0.50, 0.16, 0.48), cloth, 0.05, 0.006)
    make.soft((0.0, 0.10, 0.255), (0.70, 0.61, 0.19), cloth, 0.09)
    make.soft((0.0, 0.20, 0.155), (0.46, 0.34, 0.09), cloth, 0.045, 0.015, solid=False)
    for side in (-1.0, 1.0):
        make.soft((side * 0.33, -0.02, -0.03), (0.14, 0.40, 0.60), cloth, 0.065)
        for z in (-0.27, 0.27):
            make.post((side * 0.30, -0.311, z), 0.018, 0.102, "oak")
    free = Receptacle(
        "receptacle_aabb_Chr1_Top1_frl_apartment_chair_01",
        (0.0, seat + 0.0946, -0.115),
        (0.22, 0.0946, 0.21),
    )
    return ObjectModel("frl_apartment_chair_01", "chair", 22.0, make.parts, make.solids(), [free])


def _dining_chair() -> ObjectModel:
    """Return a light wooden chair whose seat goes under the dining table."""
    make, wood, floor = Builder(), "birch", -0.456
    make.soft((0.0, 0.0, -0.02), (0.43, 0.035, 0.43), wood, 0.012)
    make.soft((0.0, 0.026, -0.02), (0.39, 0.03, 0.38), "cream_cloth", 0.014, solid=False)
    for x in (-0.185, 0.185):
        make.post((x, (floor - 0.0175) / 2, -0.20), 0.015, -0.0175 - floor, wood)
        make.post((x, (floor + 0.40) / 2, 0.185), 0.015, 0.40 - floor, wood)
        make.box((x, -0.25, -0.008), (0.018, 0.022, 0.36), wood, 0.003, solid=False)
    make.soft((0.0, 0.335, 0.185), (0.40, 0.12, 0.022), wood, 0.010)
    make.soft((0.0, 0.175, 0.185), (0.38, 0.05, 0.018), wood, 0.008)
    return ObjectModel("frl_apartment_chair_04", "chair", 4.0, make.parts, make.solids())


def _padded_chair() -> ObjectModel:
    """Return a padded chair with a high back on black legs; it faces -z."""
    make, cloth = Builder(), "chair_cloth"
    make.soft((0.0, 0.455, -0.02), (0.412, 0.075, 0.44), cloth, 0.03, 0.004)
    make.soft((0.0, 0.69, 0.215), (0.40, 0.42, 0.06), cloth, 0.028, 0.006)
    for x in (-0.17, 0.17):
        for z in (-0.20, 0.19):
            make.post((x, 0.21, z), 0.012, 0.42, "black_metal")
    return finished("chair_05", "chair", 6.4, make)


def _stool() -> ObjectModel:
    make, floor = Builder(), -0.28
    make.see(shapes.cylinder((0.0, 0.105, 0.0), 0.19, 0.045, "oak", sides=28, bevel_m=0.008))
    make.convexes.append(solids.frustum(0.19, 0.19, 0.0825, 0.1275, 20))
    for k in range(4):
        angle = math.pi / 4 + k * math.pi / 2
        x, z = 0.13 * math.cos(angle), 0.13 * math.sin(angle)
        make.post((x, (floor + 0.0825) / 2, z), 0.014, 0.0825 - floor, "oak")
    return ObjectModel("frl_apartment_stool_02", "stool", 5.8, make.parts, make.solids())


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


def _bed() -> ObjectModel:
    """Return a double bed; the head is at +z."""
    make, floor = Builder(), -0.30
    make.box((0.0, floor + 0.20, 0.0), (1.62, 0.12, 2.04), "oak", 0.008)
    make.soft((0.0, floor + 0.36, -0.01), (1.58, 0.20, 1.98), "linen", 0.05)
    make.soft((0.0, floor + 0.39, -0.26), (1.66, 0.19, 1.52), "duvet", 0.07, 0.015, solid=False)
    make.soft((0.0, floor + 0.46, 0.42), (1.64, 0.08, 0.28), "linen", 0.038, 0.008, solid=False)
    make.boxes.append(Box((0.0, floor + 0.48, -0.18), (1.60, 0.04, 1.50)))
    for x in (-0.39, 0.39):
        make.soft((x, floor + 0.505, 0.76), (0.66, 0.12, 0.40), "linen", 0.058, 0.03)
        for z in (-0.92, 0.92):
            make.box((1.9 * x, floor + 0.07, z), (0.07, 0.14, 0.07), "oak", 0.006)
    make.soft((0.0, floor + 0.42, 1.045), (1.66, 0.72, 0.05), "chair_cloth", 0.02)
    return ObjectModel("apartment_bed", "bed", 60.0, make.parts, make.solids())


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
