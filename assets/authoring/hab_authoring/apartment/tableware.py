"""Tableware: bowls, cups, plates and the saucepan."""

from hab_authoring.apartment import outlines, shapes, solids, vessels
from hab_authoring.apartment.builder import Builder, finished
from hab_authoring.apartment.model import Box, ObjectModel, Vec3
from hab_authoring.apartment.vessels import Vessel, curve

GLAZED_FRICTION = 0.6


def build() -> list[ObjectModel]:
    """Return all of it."""
    return [
        _bowl("01", 0.126, 0.105, 0.055, 0.90, "glaze_white", "glaze_white"),
        _bowl("02", 0.117, 0.090, 0.050, 0.75, "glaze_blue", "glaze_white"),
        _bowl("03", 0.095, 0.080, 0.042, 0.50, "glaze_sage", "glaze_sage"),
        _bowl("06", 0.080, 0.062, 0.036, 0.32, "glaze_rust", "glaze_white"),
        _bowl("07", 0.165, 0.115, 0.080, 1.10, "walnut", "walnut", wall_m=0.009),
        _cup("01", curve(0.028, 0.046, 0.070, 0.45), 0.24, "glaze_white"),
        _cup("02", [(0.038, 0.0), (0.042, 0.100)], 0.34, "glaze_sage"),
        _cup("03", curve(0.024, 0.047, 0.056, 0.5), 0.38, "glaze_white", saucer_m=0.075),
        _cup("05", curve(0.020, 0.036, 0.050, 0.4), 0.28, "glaze_blue", saucer_m=0.060),
        _plate("01", 0.128, 0.022, 0.52, "glaze_white"),
        _plate("02", 0.170, 0.032, 1.05, "glaze_blue"),
        _saucepan(),
    ]


def _bowl(
    number: str,
    radius: float,
    height: float,
    foot: float,
    mass_kg: float,
    material: str,
    lining: str,
    wall_m: float = 0.005,
) -> ObjectModel:
    make = Builder()
    vessels.add(
        make,
        Vessel(
            outside=curve(foot, radius, height, 0.55),
            wall_m=wall_m,
            floor_m=0.009,
            material=material,
            lining=lining,
        ),
    )
    return finished(f"bowl_{number}", "bowl", mass_kg, make, GLAZED_FRICTION)


def _cup(
    number: str,
    outside: vessels.Chain,
    mass_kg: float,
    material: str,
    saucer_m: float | None = None,
) -> ObjectModel:
    """Return a cup, its handle towards +x; with a saucer it stands in it."""
    make, base = Builder(), 0.0
    if saucer_m is not None:
        base = 0.008
        _saucer(make, saucer_m, material)
    vessels.add(
        make,
        Vessel(
            outside=outside,
            wall_m=0.0035,
            floor_m=0.006,
            material=material,
            lining="glaze_white",
            pieces=6 if saucer_m is None else 5,
            sides=20,
        ),
        base,
    )
    height = outside[-1][1]
    _ear(make, outside, base, reach=0.36 * height + 0.008, material=material)
    return finished(f"cup_{number}", "cup", mass_kg, make, GLAZED_FRICTION)


def _saucer(make: Builder, radius: float, material: str) -> None:
    foot, rim = 0.55 * radius, 0.016
    side = [(foot, 0.0), (0.8 * radius, 0.006), (radius, rim)]
    inside = [(radius - 0.002, rim + 0.001), (0.75 * radius, 0.0095), (foot, 0.008), (0.0, 0.008)]
    make.see(shapes.lathe([[(0.0, 0.0), side[0]], side, inside], material, 24))
    make.convexes.append(solids.frustum(foot, 0.97 * radius, 0.0, rim * 0.8, 16))


def _ear(make: Builder, outside: vessels.Chain, base: float, reach: float, material: str) -> None:
    """Add a cup's handle, and one box for it."""
    height = outside[-1][1]
    low, high = 0.24 * height, 0.86 * height
    start = vessels.radius_at(outside, high) - 0.002
    end = vessels.radius_at(outside, low) - 0.002
    far = start + reach
    loop: list[Vec3] = [
        (start, high, 0.0),
        (start + 0.7 * reach, high - 0.002, 0.0),
        (far, 0.62 * high + 0.38 * low, 0.0),
        ((end + far) / 2 + 0.004, 1.08 * low, 0.0),
        (end, low - 0.002, 0.0),
    ]
    path = [(x, y + base, z) for x, y, z in outlines.bent(loop, 11)]
    make.see(shapes.tube(path, 0.0042, material, 8))
    near = min(start, end)
    make.boxes.append(
        Box(
            ((near + far) / 2 + 0.004, base + (low + high) / 2, 0.0),
            (far - near - 0.006, high - low + 0.006, 0.008),
        )
    )


def _plate(number: str, radius: float, height: float, mass_kg: float, material: str) -> ObjectModel:
    make, foot = Builder(), 0.62 * radius
    vessels.add(
        make,
        Vessel(
            outside=[(foot, 0.0), (0.78 * radius, 0.35 * height), (radius, height)],
            wall_m=0.007,
            floor_m=0.006,
            material=material,
            lining=material,
            sides=32,
        ),
    )
    return finished(f"plate_{number}", "plate", mass_kg, make, GLAZED_FRICTION)


def _saucepan() -> ObjectModel:
    """Return a steel saucepan, its handle towards +z."""
    make, radius, height = Builder(), 0.092, 0.085
    vessels.add(
        make,
        Vessel(
            outside=[(radius - 0.004, 0.0), (radius, height)],
            wall_m=0.004,
            floor_m=0.006,
            material="steel",
            lining="steel",
            pieces=6,
            sides=28,
        ),
    )
    grip = shapes.cylinder((0.0, height + 0.012, radius + 0.10), 0.011, 0.13, "black_plastic", "z")
    stem = [(0.0, height - 0.02, radius - 0.003), (0.0, height + 0.01, radius + 0.045)]
    make.see(grip, shapes.tube(stem, 0.006, "steel", 8))
    make.boxes.append(Box((0.0, height + 0.005, radius + 0.082), (0.022, 0.034, 0.166)))
    return finished("pan_01", "pan", 0.95, make)
