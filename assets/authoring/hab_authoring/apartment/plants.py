"""Plants in pots and twigs in a vase."""

import math

import numpy as np

from hab_authoring.apartment import shapes, solids
from hab_authoring.apartment.builder import Builder
from hab_authoring.apartment.model import Array, ObjectModel, Part


def build() -> list[ObjectModel]:
    """Return all of them."""
    return [_broad_leaf_plant(), _tall_plant(), _vase()]


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
