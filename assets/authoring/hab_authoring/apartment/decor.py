"""Plants in pots, twigs in a vase, books, and two bicycles on their stands, pointing along +z."""

import math

import numpy as np

from hab_authoring.apartment import shapes, solids
from hab_authoring.apartment.builder import Builder, finished
from hab_authoring.apartment.model import Array, Box, ObjectModel, Part, Vec3


def build() -> list[ObjectModel]:
    """Return all of them."""
    return [
        _broad_leaf_plant(),
        _tall_plant(),
        _vase(),
        _book("01", 0.027, 0.147, 0.205, 0.52, "label_teal", "label_cream"),
        _book("02", 0.052, 0.150, 0.230, 1.15, "label_brown", "brass"),
        _book("03", 0.018, 0.118, 0.180, 0.24, "label_orange", "label_white"),
        _book("04", 0.016, 0.110, 0.175, 0.20, "label_cream", "label_red"),
        _book("05", 0.024, 0.210, 0.250, 0.95, "label_blue", "label_white"),
        _row(),
        _bike("01", 13.5, "paint_teal", step_through=True),
        _bike("02", 11.5, "paint_red", step_through=False),
    ]


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


COVERS = (
    "label_teal",
    "label_red",
    "label_cream",
    "label_brown",
    "label_blue",
    "label_green",
    "paper",
    "label_orange",
)


def _book(
    number: str, thick: float, width: float, height: float, mass_kg: float, cover: str, ink: str
) -> ObjectModel:
    """Return a book on its back: thickness along y, spine at -x, top of the page at -z."""
    make, board = Builder(), 0.0025
    for y in (board / 2, thick - board / 2):
        make.see(shapes.box((0.0, y, 0.0), (width, board, height), cover, 0.0008))
    make.see(
        shapes.box((-width / 2 + 0.0025, thick / 2, 0.0), (0.005, thick, height), cover, 0.002),
        shapes.box(
            (0.001, thick / 2, 0.0), (width - 0.010, thick - 0.003, height - 0.008), "paper", 0.0
        ),
        shapes.box((0.004, thick, -0.22 * height), (0.66 * width, 0.0008, 0.10 * height), ink, 0.0),
        shapes.box((0.004, thick, -0.08 * height), (0.42 * width, 0.0008, 0.03 * height), ink, 0.0),
        shapes.box((0.004, thick, 0.34 * height), (0.30 * width, 0.0008, 0.03 * height), ink, 0.0),
        shapes.box(
            (-width / 2, thick / 2, -0.1 * height), (0.0008, 0.4 * thick, 0.5 * height), ink, 0.0
        ),
    )
    make.boxes.append(Box((0.0, thick / 2, 0.0), (width, thick, height)))
    return finished(f"book_{number}", "book", mass_kg, make)


def _row() -> ObjectModel:
    """Return a row of books between the boards of a shelf; spines face +z."""
    make, rng, at = Builder(), np.random.default_rng(103), -0.17
    while at < 0.16:
        thick, height = 0.018 + 0.022 * float(rng.random()), 0.17 + 0.055 * float(rng.random())
        depth, cover = 0.13 + 0.03 * float(rng.random()), COVERS[int(rng.integers(len(COVERS)))]
        y, z = -0.11 + height / 2, 0.08 - depth / 2
        make.box((at + thick / 2, y, z), (thick - 0.001, height, depth), cover, 0.002, solid=False)
        make.see(
            shapes.box(
                (at + thick / 2, y + 0.002, z - 0.004),
                (thick - 0.006, height, depth - 0.004),
                "paper",
                0.0,
            )
        )
        make.see(
            shapes.box(
                (at + thick / 2, y + 0.05, 0.0803), (thick - 0.004, 0.012, 0.001), "brass", 0.0
            )
        )
        at += thick
    make.boxes.append(Box((-0.0, 0.0, 0.0), (0.36, 0.22, 0.16)))
    return finished("book_06", "book", 4.8, make)


WHEEL_M, HUB_M = 0.335, 0.335  # radius, and height of the axle
REAR_M, FRONT_M = -0.50, 0.53


def _bike(number: str, mass_kg: float, paint: str, step_through: bool) -> ObjectModel:
    make = Builder()
    _wheel(make, REAR_M)
    _wheel(make, FRONT_M)
    crank: Vec3 = (0.0, 0.30, -0.08)
    seat: Vec3 = (0.0, 0.78, -0.22)
    head: Vec3 = (0.0, 0.80, 0.34)
    neck: Vec3 = (0.0, 0.68, 0.38)
    top = [(0.0, 0.42, -0.09), neck] if step_through else [(0.0, 0.74, -0.205), (0.0, 0.76, 0.35)]
    frames = [[crank, seat], [crank, neck], top, [head, neck]]
    for side in (-0.055, 0.055):
        frames.append([(side, HUB_M, REAR_M), (0.3 * side, 0.32, -0.12)])
        frames.append([(side, HUB_M, REAR_M), (0.3 * side, 0.72, -0.20)])
        frames.append([(0.4 * side, 0.69, 0.385), (side, 0.62, 0.40), (side, HUB_M, FRONT_M)])
    for path in frames:
        radius = 0.016 if abs(path[0][0]) < 1e-6 else 0.009
        make.see(shapes.tube(path, radius, paint, 6))
    _saddle(make)
    _bars(make, 0.16 if step_through else 0.02, swept=step_through)
    _drive(make, crank)
    _stand(make)
    if step_through:
        make.see(shapes.box((0.0, 0.74, -0.48), (0.14, 0.012, 0.36), "black_metal", 0.003))
        for side in (-0.06, 0.06):
            make.see(
                shapes.tube([(side, 0.735, -0.60), (side, HUB_M, REAR_M)], 0.004, "black_metal", 6)
            )
    _collide(make, 0.98 if step_through else 0.88)
    return finished(f"bike_{number}", "bike", mass_kg, make)


def _wheel(make: Builder, z: float) -> None:
    turn = np.linspace(0, 2 * math.pi, 6)
    tyre = [(WHEEL_M - 0.018 + 0.018 * math.cos(a), 0.018 * math.sin(a)) for a in turn]
    rim = [(0.302, -0.010), (0.302, 0.010), (0.292, 0.010), (0.292, -0.010), (0.302, -0.010)]
    make.see(
        shapes.lathe([tyre], "rubber", 24, (0.0, HUB_M, z), "x"),
        shapes.lathe([rim], "steel", 24, (0.0, HUB_M, z), "x"),
        shapes.cylinder((0.0, HUB_M, z), 0.020, 0.09, "steel", "x", 12),
    )
    for k in range(9):
        angle = math.pi * k / 9
        tip = np.array([0.0, math.sin(angle), math.cos(angle)]) * 0.295
        middle = np.array([0.0, HUB_M, z])
        ends = [tuple(middle - tip), tuple(middle + tip)]
        make.see(shapes.tube(ends, 0.0018, "steel", 3))


def _saddle(make: Builder) -> None:
    make.see(
        shapes.tube([(0.0, 0.77, -0.217), (0.0, 0.87, -0.245)], 0.012, "steel", 8),
        shapes.soft_box((0.0, 0.895, -0.30), (0.15, 0.05, 0.14), "black_plastic", 0.022),
        shapes.soft_box((0.0, 0.897, -0.19), (0.06, 0.042, 0.18), "black_plastic", 0.019),
    )


def _bars(make: Builder, rise: float, swept: bool) -> None:
    base = 0.84
    y, back = base + rise, 0.28 if swept else 0.35
    make.see(shapes.tube([(0.0, 0.79, 0.34), (0.0, y, 0.33)], 0.013, "steel", 8))
    for side in (-1.0, 1.0):
        path = [
            (0.0, y, 0.33),
            (side * 0.12, y, 0.36),
            (side * 0.24, y, back),
            (side * 0.28, y, back - (0.10 if swept else 0.0)),
        ]
        make.see(shapes.tube(path, 0.011, "black_metal", 8))
        end, grip = np.array(path[-1]), np.array(path[-2])
        near = tuple(grip + (end - grip) * 0.1)
        make.see(shapes.tube([near, tuple(end + (end - grip) * 0.05)], 0.016, "black_plastic", 8))


def _drive(make: Builder, crank: Vec3) -> None:
    _, y, z = crank
    make.see(
        shapes.cylinder((0.05, y, z), 0.095, 0.006, "steel", "x", 24, 0.001),
        shapes.cylinder((0.055, HUB_M, REAR_M), 0.045, 0.006, "steel", "x", 16, 0.001),
        shapes.tube([(0.05, y + 0.09, z), (0.055, HUB_M + 0.043, REAR_M)], 0.004, "black_metal", 6),
        shapes.tube([(0.05, y - 0.09, z), (0.055, HUB_M - 0.043, REAR_M)], 0.004, "black_metal", 6),
    )
    for side, drop in ((1.0, -0.15), (-1.0, 0.15)):
        foot = (side * 0.075, y + drop, z + 0.06)
        make.see(
            shapes.tube([(side * 0.06, y, z), foot], 0.009, "steel", 6),
            shapes.box(
                (side * 0.125, y + drop, z + 0.06), (0.09, 0.018, 0.07), "black_plastic", 0.004
            ),
        )


def _stand(make: Builder) -> None:
    """Add a stand of two legs, which keeps the bike upright."""
    for side in (-1.0, 1.0):
        make.see(
            shapes.tube(
                [(side * 0.03, 0.29, -0.14), (side * 0.16, 0.008, -0.17)], 0.009, "black_metal", 6
            ),
            shapes.box((side * 0.165, 0.006, -0.17), (0.03, 0.012, 0.08), "black_plastic", 0.003),
        )


def _collide(make: Builder, bar_m: float) -> None:
    for z in (REAR_M, FRONT_M):
        make.boxes.append(Box((0.0, WHEEL_M, z), (0.06, 2 * WHEEL_M, 1.8 * WHEEL_M)))
    make.boxes += [
        Box((0.0, 0.52, 0.02), (0.05, 0.56, 0.60)),
        Box((0.0, 0.80, -0.26), (0.14, 0.24, 0.24)),
        Box((0.0, (0.76 + bar_m) / 2 + 0.02, 0.30), (0.56, 0.08 + bar_m - 0.80, 0.16)),
        Box((0.0, 0.14, -0.15), (0.34, 0.28, 0.12)),
    ]
