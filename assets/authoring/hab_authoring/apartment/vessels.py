"""Turned hollow things that stand on y = 0 and are open at the top: bowls, cups, pots, bins."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hab_authoring.apartment import shapes, solids
from hab_authoring.apartment.builder import Builder
from hab_authoring.apartment.model import Array, Convex

Chain = list[tuple[float, float]]


@dataclass(frozen=True)
class Vessel:
    """The outside as (radius, height) in metres from the foot's edge to the rim, and its wall."""

    outside: Chain
    wall_m: float
    floor_m: float
    material: str
    lining: str
    pieces: int = 7
    sides: int = 24
    base_m: float = 0.0


def curve(foot_m: float, rim_m: float, height_m: float, power: float, steps: int = 6) -> Chain:
    """Return an outside that bulges for powers below 1, is a cone at 1, and flares above."""
    share = np.linspace(0.0, 1.0, steps)
    return [(foot_m + (rim_m - foot_m) * float(t) ** power, height_m * float(t)) for t in share]


def add(make: Builder, vessel: Vessel) -> None:
    """Add the vessel's surfaces, its bottom, and a ring of convex wall pieces."""
    out, wall, floor = vessel.outside, vessel.wall_m, vessel.floor_m
    inside, base_m = _inside(vessel), vessel.base_m
    rim = [out[-1], (out[-1][0] - wall / 2, out[-1][1] + wall / 2), inside[0]]
    place = (0.0, base_m, 0.0)
    make.see(
        shapes.lathe([[(0.0, 0.0), out[0]], out], vessel.material, vessel.sides, place),
        shapes.lathe([rim, inside], vessel.lining, vessel.sides, place),
    )
    make.convexes.append(
        solids.frustum(out[0][0], radius_at(out, floor), base_m, base_m + floor, 16)
    )
    make.convexes += [solids.moved(piece, place) for piece in _walls(vessel)]


def radius_at(chain: Chain, height_m: float) -> float:
    """Return the radius of a chain with rising heights."""
    return float(np.interp(height_m, [y for _, y in chain], [r for r, _ in chain]))


def _inside(vessel: Vessel) -> Chain:
    wall, floor = vessel.wall_m, vessel.floor_m
    above = [(r - wall, y) for r, y in vessel.outside if y > floor * 1.2]
    low = (radius_at(vessel.outside, floor) - wall, floor)
    return [*above[::-1], low, (0.0, floor)]


def _walls(vessel: Vessel) -> list[Convex]:
    """Return wall pieces whose outside follows the bulge; their inside is a straight cone."""
    out, wall, floor = vessel.outside, vessel.wall_m, vessel.floor_m
    top = out[-1][1]
    outer: Chain = [(radius_at(out, floor), floor), *((r, y) for r, y in out if y > floor * 1.2)]
    inner: Chain = [(outer[0][0] - wall, floor), (out[-1][0] - wall, top)]
    turn = 2 * np.pi / vessel.pieces
    return [
        solids.hull(
            np.vstack([ring(outer, np.array([0, 0.5, 1]) * turn), ring(inner, np.array([0, turn]))])
            @ shapes.rotation_matrix("y", -k * turn).T
        )
        for k in range(vessel.pieces)
    ]


def ring(chain: Sequence[tuple[float, float]], angles_rad: Array) -> Array:
    """Return the points (N, 3) of a profile at the given angles about +y."""
    return np.array(
        [(r * np.cos(a), y, r * np.sin(a)) for a in angles_rad for r, y in chain], float
    )
