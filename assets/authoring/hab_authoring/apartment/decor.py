"""Decoration: rugs, plants, pictures, lamps and screens."""

import math

import numpy as np

from hab_authoring.apartment import shapes, solids
from hab_authoring.apartment.builder import Builder, finished
from hab_authoring.apartment.model import Array, Box, ObjectModel, Part


def build() -> list[ObjectModel]:
    """Return all decoration."""
    return [
        _rug("frl_apartment_rug_01", "rug", 5.4, (1.60, 2.30), "rug_small"),
        _rug("frl_apartment_rug_02", "rug", 12.0, (2.70, 2.40), "rug_large"),
        _rug("frl_apartment_mat", "mat", 1.0, (0.94, 0.588), "mat_weave"),
        _broad_leaf_plant(),
        _tall_plant(),
        _picture("01", 0.43, 0.546, "painting_01"),
        _picture("02", 0.80, 0.58, "painting_02"),
        _picture("03", 0.56, 0.70, "painting_03"),
        _table_lamp(),
        _floor_lamp(),
        _tv_screen(),
        _clock(),
        _vase(),
        _bottle_vase(),
        _photo_frame(),
    ]


def _rug(
    name: str,
    category: str,
    mass_kg: float,
    size: tuple[float, float],
    material: str,
) -> ObjectModel:
    """Return a flat rug, its pattern stretched once over it."""
    make, (width, depth), half = Builder(), size, 0.006
    make.box((0.0, -0.001, 0.0), (width, 2 * half - 0.002, depth), "rug_edge", 0.003)
    if material == "mat_weave":
        make.see(
            shapes.box(
                (0.0, half - 0.002, 0.0), (width - 0.04, 0.004, depth - 0.04), material, 0.001
            )
        )
    else:
        make.see(_print(width - 0.02, depth - 0.02, half, material))
    return ObjectModel(name, category, mass_kg, make.parts, make.solids(), friction=0.9)


def _print(width: float, depth: float, height: float, material: str) -> Part:
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [width / 2, depth / 2]
    points = np.stack([corners[:, 0], np.full(4, height), corners[:, 1]], axis=1)
    uv = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])
    return Part(
        points, np.tile([0.0, 1.0, 0.0], (4, 1)), uv, np.array([[0, 2, 1], [0, 3, 2]]), material
    )


def _picture(number: str, width: float, height: float, material: str) -> ObjectModel:
    """Return a framed picture; it hangs with its back at -z."""
    make, rim, wood = Builder(), 0.022, "walnut" if number == "01" else "oak"
    make.boxes.append(Box((0.0, 0.0, 0.0), (width, height, 0.036)))
    make.see(shapes.box((0.0, 0.0, -0.006), (width - 0.01, height - 0.01, 0.012), "paper", 0.001))
    for side in (-1.0, 1.0):
        make.box(
            (side * (width - rim) / 2, 0.0, 0.0), (rim, height, 0.036), wood, 0.003, solid=False
        )
        make.box(
            (0.0, side * (height - rim) / 2, 0.0),
            (width - 2 * rim, rim, 0.036),
            wood,
            0.003,
            solid=False,
        )
    board = 0.05
    sheet = shapes.rotated(
        _print(width - 2 * (rim + board), height - 2 * (rim + board), 0.0008, material),
        "x",
        math.pi / 2,
    )
    make.see(sheet)
    return ObjectModel(f"frl_apartment_picture_{number}", "picture", 0.8, make.parts, make.solids())


def _leaf(base: Array, direction: Array, length: float, width: float, droop: float) -> list[Part]:
    """Return a folded, drooping leaf as two strips of quads, seen from both sides."""
    side = np.cross(direction, [0.0, 1.0, 0.0])
    side /= max(float(np.linalg.norm(side)), 1e-9)
    stations = np.linspace(0, 1, 5)
    spine = [
        base + direction * length * t - np.array([0, droop * length * t * t, 0]) for t in stations
    ]
    half = [width / 2 * math.sin(math.pi * (0.06 + 0.94 * t) ** 0.8) for t in stations]
    half[-1] = 0.0
    rows = []
    for place, wide in zip(spine, half, strict=True):
        lift = np.array([0, 0.25 * wide, 0])
        rows.append([place - side * wide + lift, place, place + side * wide + lift])
    points = np.array(rows).reshape(-1, 3)
    faces = []
    for row in range(4):
        for column in range(2):
            a = row * 3 + column
            faces += [[a, a + 1, a + 4], [a, a + 4, a + 3]]
    uv = np.array([[t, 0.5 * column] for t in stations for column in range(3)])
    tri = np.array(faces)
    flat = np.cross(points[tri[:, 1]] - points[tri[:, 0]], points[tri[:, 2]] - points[tri[:, 0]])
    normal = np.zeros_like(points)
    for k in range(3):
        np.add.at(normal, tri[:, k], flat)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    return [Part(points, normal, uv, tri, "leaf"), Part(points, -normal, uv, tri[:, ::-1], "leaf")]


def _pot(make: Builder, floor: float, height: float, radius: float, material: str) -> None:
    wall, low = 0.016, radius * 0.74
    rim = floor + height
    make.see(
        shapes.lathe(
            [
                [(0.0, floor), (low, floor)],
                [(low, floor), (radius, rim - 0.01), (radius, rim)],
                [(radius, rim), (radius - wall, rim)],
                [(radius - wall, rim), (radius - wall - 0.004, rim - 0.05)],
            ],
            material,
            24,
        )
    )
    make.see(shapes.cylinder((0.0, rim - 0.045, 0.0), radius - wall, 0.02, "soil", sides=20))
    make.convexes.append(solids.frustum(low, radius, floor, rim, 16))


def _broad_leaf_plant() -> ObjectModel:
    """Return a rubber plant: three stems with broad leaves in a ceramic pot."""
    make, floor, rng = Builder(), -0.509, np.random.default_rng(101)
    _pot(make, floor, 0.36, 0.21, "ceramic")
    for k in range(4):
        angle = 2 * math.pi * k / 4 + 0.4
        lean = np.array([math.cos(angle) * 0.08, 0.0, math.sin(angle) * 0.08])
        foot, height = (
            np.array([lean[0] * 0.3, floor + 0.31, lean[2] * 0.3]),
            0.72 + 0.32 * float(rng.random()),
        )
        tip = foot + lean * 1.2 + np.array([0.0, height, 0.0])
        make.see(
            shapes.tube(
                [tuple(foot), tuple((foot + tip) / 2 + lean * 0.2), tuple(tip)], 0.009, "bark", 6
            )
        )
        for j in range(9):
            t = 0.22 + 0.78 * j / 8
            turn = angle + 2.4 * j + float(rng.uniform(-0.3, 0.3))
            rise = 0.25 + 0.6 * t
            direction = np.array([math.cos(turn), rise, math.sin(turn)])
            direction /= float(np.linalg.norm(direction))
            make.see(
                *_leaf(
                    foot + (tip - foot) * t,
                    direction,
                    0.18 + 0.06 * float(rng.random()),
                    0.10,
                    0.35,
                )
            )
    make.convexes.append(solids.moved(solids.ball((0.24, 0.48, 0.24), 4, 10), (0.0, 0.42, 0.0)))
    return ObjectModel(
        "frl_apartment_indoor_plant_01", "indoor_plant", 25.0, make.parts, make.solids()
    )


def _tall_plant() -> ObjectModel:
    """Return a palm: a crown of feathered fronds in a terracotta pot."""
    make, floor, rng = Builder(), -0.976, np.random.default_rng(102)
    _pot(make, floor, 0.34, 0.20, "terracotta")
    for k in range(11):
        angle = 2.4 * k
        reach = 0.08 + 0.12 * float(rng.random())
        top = 0.25 + 0.50 * float(rng.random())
        foot = np.array([0.03 * math.cos(angle), floor + 0.29, 0.03 * math.sin(angle)])
        out = np.array([math.cos(angle), 0.0, math.sin(angle)])
        path = [
            foot
            + out * reach * t**2
            + np.array([0.0, (top - floor - 0.29) * math.sin(t * 1.45) / math.sin(1.45), 0.0])
            for t in np.linspace(0, 1, 7)
        ]
        make.see(shapes.tube([tuple(p) for p in path], 0.006, "stalk", 5))
        for j in range(3, 7):
            for side in (-0.75, 0.75):
                direction = np.array([math.cos(angle + side), 0.35, math.sin(angle + side)])
                make.see(
                    *_leaf(path[j], direction / float(np.linalg.norm(direction)), 0.15, 0.05, 0.6)
                )
        make.see(*_leaf(path[-1], out * 0.8 + np.array([0, 0.6, 0]), 0.17, 0.06, 0.9))
    make.convexes.append(solids.frustum(0.08, 0.28, floor + 0.34, 0.20, 10))
    make.convexes.append(solids.frustum(0.28, 0.14, 0.20, 0.75, 10))
    return ObjectModel(
        "frl_apartment_indoor_plant_02", "indoor_plant", 25.0, make.parts, make.solids()
    )


def _shade(make: Builder, low: float, high: float, r_low: float, r_high: float) -> None:
    t = 0.004
    make.see(
        shapes.lathe(
            [
                [(r_low, low), (r_high, high)],
                [(r_high, high), (r_high - t, high)],
                [(r_high - t, high), (r_low - t, low)],
                [(r_low - t, low), (r_low, low)],
            ],
            "lamp_shade",
            28,
        )
    )
    make.see(shapes.sphere((0.0, (low + high) / 2, 0.0), (0.03, 0.04, 0.03), "lamp_shade", 6, 10))
    make.convexes.append(solids.frustum(r_low, r_high, low, high, 12))


def _table_lamp() -> ObjectModel:
    make, floor = Builder(), -0.22
    body = (
        [(0.0, floor), (0.075, floor)],
        [
            (0.075, floor),
            (0.078, floor + 0.012),
            (0.05, floor + 0.03),
            (0.03, floor + 0.06),
            (0.055, floor + 0.12),
            (0.062, floor + 0.16),
            (0.045, floor + 0.21),
            (0.012, floor + 0.24),
            (0.010, floor + 0.30),
        ],
    )
    make.see(shapes.lathe(body, "ceramic", 20))
    make.convexes += [
        solids.frustum(0.078, 0.065, floor, floor + 0.21, 12),
        solids.frustum(0.012, 0.012, floor + 0.21, floor + 0.26, 8),
    ]
    _shade(make, floor + 0.26, floor + 0.46, 0.15, 0.105)
    return ObjectModel("frl_apartment_lamp_02", "lamp", 4.0, make.parts, make.solids())


def _floor_lamp() -> ObjectModel:
    make, floor = Builder(), -0.85
    make.see(
        shapes.cylinder(
            (0.0, floor + 0.0125, 0.0), 0.15, 0.025, "black_metal", sides=28, bevel_m=0.006
        )
    )
    make.convexes.append(solids.frustum(0.15, 0.15, floor, floor + 0.025, 16))
    make.post((0.0, floor + 0.675, 0.0), 0.011, 1.30, "black_metal")
    _shade(make, floor + 1.30, floor + 1.58, 0.21, 0.15)
    return ObjectModel("frl_apartment_lamp_01", "lamp", 6.5, make.parts, make.solids())


def _tv_screen() -> ObjectModel:
    """Return a wall-mounted screen; the front is -z and the wall at +0.16."""
    make = Builder()
    make.box((0.0, 0.0, -0.02), (1.46, 0.84, 0.045), "black_plastic", 0.008)
    make.see(shapes.box((0.0, 0.006, -0.0425), (1.44, 0.81, 0.003), "screen", 0.001))
    make.box((0.0, 0.0, 0.080), (0.46, 0.40, 0.156), "black_plastic", 0.006)
    return ObjectModel("frl_apartment_tv_screen", "tv_screen", 22.0, make.parts, make.solids())


def _clock() -> ObjectModel:
    """Return a wall clock showing ten past ten; its back is at -z."""
    make = Builder()
    make.see(shapes.cylinder((0.0, 0.0, 0.0), 0.15, 0.036, "walnut", "z", 32, 0.006))
    make.see(shapes.cylinder((0.0, 0.0, 0.015), 0.132, 0.010, "label_white", "z", 32, 0.001))
    for k in range(12):
        angle = k * math.pi / 6
        tick = shapes.box(
            (0.0, 0.116, 0.0205), (0.006 if k % 3 else 0.010, 0.018, 0.001), "black_plastic", 0.0
        )
        make.see(shapes.rotated(tick, "z", -angle))
    for angle, length in ((-0.95, 0.07), (1.05, 0.10)):
        hand = shapes.box((0.0, length / 2, 0.022), (0.006, length, 0.001), "black_plastic", 0.0)
        make.see(shapes.rotated(hand, "z", angle))
    make.convexes.append(
        solids.rotated(solids.frustum(0.15, 0.15, -0.018, 0.018, 20), "x", math.pi / 2)
    )
    return ObjectModel("frl_apartment_clock", "clock", 0.8, make.parts, make.solids())


def _vase() -> ObjectModel:
    """Return a vase with dry twigs."""
    make, floor, rng = Builder(), -0.15, np.random.default_rng(104)
    foot = [(0.0, 0.0), (0.045, 0.0)]
    side = [(0.045, 0.0), (0.075, 0.05), (0.085, 0.11), (0.065, 0.18), (0.032, 0.23), (0.036, 0.26)]
    lip = [(0.036, 0.26), (0.030, 0.258), (0.026, 0.20)]
    make.see(shapes.lathe([foot, side, lip], "terracotta", 22, (0.0, floor, 0.0)))
    for k in range(7):
        angle, lean = 2.4 * k, 0.05 + 0.10 * float(rng.random())
        x, z = lean * math.cos(angle), lean * math.sin(angle)
        tip = (x, floor + 0.48 + 0.14 * float(rng.random()), z)
        bend = (0.3 * x, floor + 0.34, 0.3 * z)
        make.see(shapes.tube([(0.0, floor + 0.2, 0.0), bend, tip], 0.002, "stalk", 5))
        make.see(shapes.sphere(tip, (0.012, 0.020, 0.012), "label_cream", 5, 7))
    make.convexes += [
        solids.frustum(0.045, 0.085, floor, floor + 0.10, 12),
        solids.frustum(0.085, 0.034, floor + 0.10, floor + 0.26, 12),
        solids.frustum(0.03, 0.125, floor + 0.26, floor + 0.58, 10),
    ]
    return ObjectModel("frl_apartment_vase_01", "vase", 1.2, make.parts, make.solids())


def _bottle_vase() -> ObjectModel:
    """Return a slim vase without flowers."""
    make = Builder()
    side = [
        (0.034, 0.0),
        (0.046, 0.02),
        (0.048, 0.06),
        (0.036, 0.12),
        (0.017, 0.17),
        (0.014, 0.215),
    ]
    lip = [(0.014, 0.215), (0.021, 0.250), (0.018, 0.250), (0.011, 0.212), (0.0, 0.205)]
    make.see(shapes.lathe([[(0.0, 0.0), side[0]], side, lip], "glaze_blue", 24))
    make.convexes += [
        solids.frustum(0.034, 0.048, 0.0, 0.04, 12),
        solids.frustum(0.048, 0.017, 0.04, 0.17, 12),
        solids.frustum(0.015, 0.021, 0.17, 0.25, 12),
    ]
    return finished("vase_02", "vase", 0.75, make)


def _photo_frame() -> ObjectModel:
    """Return a photo in a frame that leans back a little on a foot; it faces +z."""
    make, (w, h), rim, lean = Builder(), (0.168, 0.213), 0.016, 0.10
    pieces = [shapes.box((0.0, h / 2, -0.004), (w - 0.006, h - 0.006, 0.008), "paper", 0.001)]
    for side in (-1.0, 1.0):
        x, y = side * (w - rim) / 2, h / 2 + side * (h - rim) / 2
        pieces.append(shapes.box((x, h / 2, 0.0), (rim, h, 0.016), "walnut", 0.003))
        pieces.append(shapes.box((0.0, y, 0.0), (w - 2 * rim, rim, 0.016), "walnut", 0.003))
    photo = shapes.rotated(_print(w - 2 * rim, h - 2 * rim, 0.002, "photo"), "x", math.pi / 2)
    pieces.append(shapes.moved(photo, (0.0, h / 2, 0.0)))
    make.see(*(shapes.rotated(piece, "x", -lean) for piece in pieces))
    board = solids.rotated(solids.from_box(Box((0.0, h / 2, 0.0), (w, h, 0.016))), "x", -lean)
    make.convexes.append(solids.moved(board, (0.0, 0.0008, 0.0)))
    make.box((0.0, 0.003, -0.035), (0.05, 0.006, 0.075), "walnut", 0.001)
    return finished("picture_04", "picture", 0.4, make)
