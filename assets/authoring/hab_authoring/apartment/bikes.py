"""Two bicycles on their stands. They point along +z."""

import math

import numpy as np

from hab_authoring.apartment import shapes
from hab_authoring.apartment.builder import Builder, finished
from hab_authoring.apartment.model import Box, ObjectModel, Vec3

WHEEL_M, HUB_M = 0.335, 0.335  # radius, and height of the axle
REAR_M, FRONT_M = -0.50, 0.53


def build() -> list[ObjectModel]:
    """Return a town bike with an upright bar, and a sports bike with a straight one."""
    return [
        _bike("01", 13.5, "paint_teal", step_through=True),
        _bike("02", 11.5, "paint_red", step_through=False),
    ]


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
