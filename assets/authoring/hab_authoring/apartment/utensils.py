"""Kitchen utensils: jars, racks, trays, knives, boards, soap."""

import math
from collections.abc import Sequence

import numpy as np

from hab_authoring.apartment import outlines, shapes, solids, vessels
from hab_authoring.apartment.builder import Builder, finished, free_box
from hab_authoring.apartment.model import Box, ObjectModel, Receptacle
from hab_authoring.apartment.vessels import Vessel


def build() -> list[ObjectModel]:
    """Return all of them."""
    return [
        _casserole(),
        _soap_pump(),
        _jar("03", 0.026, 0.106, 0.16, "spice", "black_plastic"),
        _spice_rack(),
        _tray(),
        _jar("06", 0.050, 0.122, 0.45, "glaze_white", "birch"),
        _crock(),
        _mill(),
        _sponge_dish(),
        _knife_block(),
        _board(),
    ]


def _utensil(
    number: str, mass_kg: float, make: Builder, receptacles: Sequence[Receptacle] = ()
) -> ObjectModel:
    name, category = f"kitchen_utensil_{number}", "kitchen_utensil"
    return finished(name, category, mass_kg, make, receptacles=receptacles)


def _casserole() -> ObjectModel:
    """Return a closed iron casserole with two ears along x."""
    make, r, h = Builder(), 0.125, 0.105
    body = [(0.105, 0.0), (r, 0.03), (r, h)]
    lid = [(r + 0.004, h), (r + 0.004, h + 0.010), (0.09, h + 0.026), (0.03, h + 0.034)]
    make.see(
        shapes.lathe([[(0.0, 0.0), body[0]], body], "enamel_red", 32),
        shapes.lathe([[(r, h), lid[0]], lid, [lid[-1], (0.0, h + 0.034)]], "enamel_red", 32),
        shapes.cylinder((0.0, h + 0.046, 0.0), 0.018, 0.024, "steel", sides=16, bevel_m=0.005),
    )
    make.convexes += [
        solids.frustum(0.108, r, 0.0, 0.03),
        solids.frustum(r, r, 0.03, h + 0.010),
        solids.frustum(r, 0.06, h + 0.010, h + 0.032),
        solids.frustum(0.018, 0.018, h + 0.032, h + 0.058, 10),
    ]
    for side in (-1.0, 1.0):
        loop = [
            (side * (r - 0.005 + 0.042 * math.sin(t)), h - 0.022, 0.05 * math.cos(t))
            for t in np.linspace(0, math.pi, 7)
        ]
        make.see(shapes.tube(loop, 0.008, "enamel_red", 8))
        make.boxes.append(Box((side * (r + 0.019), h - 0.022, 0.0), (0.044, 0.016, 0.09)))
    return _utensil("01", 3.0, make)


def _soap_pump() -> ObjectModel:
    make, r = Builder(), 0.036
    side = [(r - 0.003, 0.0), (r, 0.004), (r, 0.10), (0.028, 0.118), (0.013, 0.124)]
    make.see(
        shapes.lathe([[(0.0, 0.0), side[0]], side], "amber", 20),
        shapes.cylinder((0.0, 0.132, 0.0), 0.014, 0.018, "black_plastic", sides=14),
        shapes.cylinder((0.0, 0.152, 0.0), 0.004, 0.026, "black_plastic", sides=8),
        shapes.box((0.0, 0.168, 0.016), (0.016, 0.010, 0.054), "black_plastic", 0.003),
        shapes.cylinder((0.0, 0.06, 0.0), r + 0.0006, 0.055, "label_cream", bevel_m=0.0),
    )
    make.convexes += [
        solids.frustum(r, r, 0.0, 0.10),
        solids.frustum(r, 0.014, 0.10, 0.141, 12),
    ]
    make.boxes.append(Box((0.0, 0.157, 0.012), (0.016, 0.034, 0.062)))
    return _utensil("02", 0.42, make)


def _jar(number: str, r: float, height: float, mass_kg: float, body: str, lid: str) -> ObjectModel:
    """Return a closed jar with a label and a lid."""
    make, lid_m = Builder(), 0.2 * height
    top = height - lid_m
    side = [(r - 0.003, 0.0), (r, 0.003), (r, top - 0.006), (r - 0.004, top)]
    make.see(
        shapes.lathe([[(0.0, 0.0), side[0]], side], body, 20),
        shapes.cylinder((0.0, 0.45 * top, 0.0), r + 0.0005, 0.45 * top, "label_cream", bevel_m=0.0),
        shapes.cylinder((0.0, height - lid_m / 2, 0.0), r - 0.001, lid_m, lid, bevel_m=0.002),
    )
    make.convexes.append(solids.frustum(r, r, 0.0, height, 16))
    return _utensil(number, mass_kg, make)


def _spice_rack() -> ObjectModel:
    """Return a wooden rack of two steps; jars stand on the steps, the higher one at the back."""
    make, w = Builder(), 0.315
    make.span((-w / 2, 0.0, 0.0), (w / 2, 0.045, 0.075), "birch", 0.003)
    make.span((-w / 2, 0.0, -0.080), (w / 2, 0.085, 0.0), "birch", 0.003)
    for x in (-w / 2 + 0.006, w / 2 - 0.006):
        make.span((x - 0.006, 0.085, -0.080), (x + 0.006, 0.103, 0.0), "birch", 0.002)
    make.see(shapes.box((0.0, 0.052, 0.074), (w, 0.014, 0.004), "birch", 0.001))
    frees = [
        free_box(
            "Rack_Front_frl_apartment_kitchen_utensil_04", (0.0, 0.045, 0.036), (0.14, 0.06, 0.03)
        ),
        free_box(
            "Rack_Back_frl_apartment_kitchen_utensil_04", (0.0, 0.085, -0.04), (0.13, 0.06, 0.03)
        ),
    ]
    return _utensil("04", 0.55, make, receptacles=frees)


def _tray() -> ObjectModel:
    """Return a serving tray with a raised border and two grips along x."""
    make, w, d = Builder(), 0.50, 0.32
    make.box((0.0, 0.005, 0.0), (w, 0.010, d), "walnut", 0.002)
    for z in (-d / 2 + 0.006, d / 2 - 0.006):
        make.box((0.0, 0.028, z), (w, 0.036, 0.012), "walnut", 0.003)
    for x in (-w / 2 + 0.006, w / 2 - 0.006):
        make.box((x, 0.028, 0.0), (0.012, 0.036, d - 0.024), "walnut", 0.003)
        side = math.copysign(1.0, x)
        loop = [
            (x, 0.036, -0.06),
            (x + side * 0.04, 0.042, -0.05),
            (x + side * 0.04, 0.042, 0.05),
            (x, 0.036, 0.06),
        ]
        make.see(shapes.tube(loop, 0.006, "brass", 8))
        make.boxes.append(Box((x + side * 0.026, 0.040, 0.0), (0.040, 0.012, 0.12)))
    free = free_box("Tray_frl_apartment_kitchen_utensil_05", (0.0, 0.010, 0.0), (0.22, 0.10, 0.13))
    return _utensil("05", 1.1, make, receptacles=[free])


def _crock() -> ObjectModel:
    """Return a stoneware crock with three spoons standing in it."""
    make, r, h = Builder(), 0.058, 0.145
    vessels.add(
        make,
        Vessel(
            outside=[(0.053, 0.0), (r, h)],
            wall_m=0.006,
            floor_m=0.012,
            material="glaze_sage",
            lining="glaze_white",
            pieces=6,
            sides=22,
        ),
    )
    tops = (
        (0.030, 0.018, 0.29, "birch"),
        (-0.034, 0.006, 0.30, "walnut"),
        (0.006, -0.036, 0.27, "steel"),
    )
    for x, z, top, material in tops:
        make.see(shapes.tube([(-0.5 * x, 0.015, -0.5 * z), (x, top - 0.03, z)], 0.005, material, 6))
        make.see(
            shapes.sphere((1.04 * x, top - 0.012, 1.04 * z), (0.020, 0.032, 0.008), material, 6, 10)
        )
    make.boxes.append(Box((0.0, 0.205, -0.004), (0.10, 0.18, 0.07)))
    return _utensil("08", 1.1, make)


def _mill() -> ObjectModel:
    make = Builder()
    side = [
        (0.030, 0.0), (0.033, 0.012), (0.031, 0.03), (0.021, 0.075), (0.019, 0.10),
        (0.027, 0.128), (0.030, 0.135), (0.030, 0.142), (0.020, 0.146),
    ]  # fmt: skip
    head = [(0.020, 0.146), (0.028, 0.152), (0.031, 0.168), (0.024, 0.184), (0.010, 0.191)]
    make.see(
        shapes.lathe([[(0.0, 0.0), side[0]], side], "walnut", 20),
        shapes.lathe([head, [head[-1], (0.0, 0.192)]], "walnut", 20),
        shapes.sphere((0.0, 0.197, 0.0), (0.009, 0.008, 0.009), "steel", 6, 10),
    )
    make.convexes += [
        solids.frustum(0.033, 0.020, 0.0, 0.09, 12),
        solids.frustum(0.020, 0.031, 0.09, 0.16, 12),
        solids.frustum(0.031, 0.012, 0.16, 0.204, 12),
    ]
    return _utensil("09", 0.38, make)


def _sponge_dish() -> ObjectModel:
    """Return a dish with a sponge and a brush handle."""
    make = Builder()
    make.box((0.0, 0.006, 0.0), (0.165, 0.012, 0.105), "glaze_white", 0.004)
    for x in (-0.078, 0.078):
        make.box((x, 0.018, 0.0), (0.009, 0.016, 0.105), "glaze_white", 0.003)
    make.soft((-0.014, 0.029, 0.0), (0.105, 0.032, 0.068), "sponge_yellow", 0.006)
    make.see(shapes.box((-0.014, 0.048, 0.0), (0.105, 0.008, 0.068), "sponge_green", 0.002))
    make.boxes.append(Box((-0.014, 0.0485, 0.0), (0.105, 0.007, 0.068)))
    return finished("sponge_dish", "kitchen_utensil", 0.42, make)


def _knife_block() -> ObjectModel:
    """Return a slanted block with five knives; their grips point up and towards +z."""
    make, w, lean = Builder(), 0.10, math.radians(22)
    profile = np.array([(-0.075, 0.0), (0.060, 0.0), (0.075, 0.175), (-0.030, 0.220)])
    corners = [(x, y, z) for x in (-w / 2, w / 2) for z, y in profile]
    hull = solids.hull(corners)
    make.convexes.append(hull)
    flat = [np.array([(x, y, z) for z, y in profile]) for x in (-w / 2, w / 2)]
    make.see(outlines.slab(flat[0], flat[1], "oak"))
    for x, length in ((-0.032, 0.11), (0.0, 0.12), (0.032, 0.11)):
        for z, scale in ((0.0, 1.0), (0.045, 0.85)):
            grip = shapes.box(
                (0.0, length * scale / 2, 0.0),
                (0.016, length * scale, 0.024),
                "black_plastic",
                0.005,
            )
            grip = shapes.rotated(grip, "x", lean)
            make.see(shapes.moved(grip, (x, 0.205 - 0.42 * z, z)))
    make.convexes.append(
        solids.moved(
            solids.rotated(solids.from_box(Box((0.0, 0.05, 0.0), (0.08, 0.12, 0.07))), "x", lean),
            (0.0, 0.195, 0.022),
        )
    )
    return finished("knifeblock", "knife_block", 1.9, make)


def _board() -> ObjectModel:
    """Return a chopping board with a grip towards +x."""
    make, t = Builder(), 0.018
    outline = outlines.rounded_rectangle(0.145, 0.125, 0.02, 4)
    make.see(*outlines.extruded(outline, 0.0, t, 0.0, "oak"))
    grip = outlines.extruded(outlines.rounded_rectangle(0.05, 0.024, 0.018, 4), 0.0, t, 0.0, "oak")
    make.see(*(shapes.moved(p, (0.17, 0.0, 0.0)) for p in grip))
    make.see(shapes.cylinder((0.198, t, 0.0), 0.008, 0.001, "gap", bevel_m=0.0, sides=12))
    make.convexes.append(solids.prism(outlines.rounded_rectangle(0.145, 0.125, 0.02, 3), 0.0, t))
    make.boxes.append(Box((0.182, t / 2, 0.0), (0.076, t, 0.046)))
    return finished("choppingboard_02", "chopping_board", 0.9, make)
