"""Models declared in `articulated.toml`, `furniture.toml`, `kitchenware.toml` and `decor.toml`.

A row is a verb, its arguments and, where needed, a table of options. `box`, `span`, `soft`, `post`
and `bar_handle` are methods of `Builder`; `see.*` adds a visible shape of `shapes` or `outlines`,
`hit.*` a collision shape of `solids`, and `vessel` both. Verbs for the rows at their
end: `flip` (axis) adds them on the other side, `mirror` there and then as they are, and `repeat`
(count, step) several times; `turn` (axis, angle) and `move` (offset) displace them. A receptacle is
a name, the centre of its bottom, and half sizes.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hab_authoring.apartment import outlines, shapes, solids
from hab_authoring.apartment.builder import FRICTION, Builder, finished, free_box
from hab_authoring.apartment.model import (
    Array,
    Articulation,
    Box,
    Convex,
    Joint,
    Link,
    ObjectModel,
    Part,
    Receptacle,
    read_table,
)

FILES = ("furniture.toml", "kitchenware.toml", "decor.toml")
LIMITS = ("lower", "upper", "velocity")
Row = Sequence[Any]


def build() -> Iterator[ObjectModel]:
    """Yield the rigid models of all files."""
    for name in FILES:
        for short, entry in read_table(name).items():
            yield _model(short, **entry)


def articulated() -> Iterator[Articulation]:
    """Yield the articulated furniture."""
    for name, links in read_table("articulated.toml").items():
        parent, mirrored = links.pop("parent_object"), links.pop("mirrored", None)
        yield _articulation(name, parent, links)
        if mirrored is not None:
            yield _articulation(
                mirrored, parent, {key: _hinged_at_minus_y(link) for key, link in links.items()}
            )


def _hinged_at_minus_y(link: dict[str, Any]) -> dict[str, Any]:
    """Return a door on the other side, and what is no door as it is."""
    if "axis" not in link:
        return link
    (x, y, z), (_, _, up) = link["xyz"], link["axis"]
    return link | {"xyz": [x, -y, z], "axis": [0, 0, -up], "rows": [["flip", "y", link["rows"]]]}


def _articulation(name: str, parent: str, entries: dict[str, dict[str, Any]]) -> Articulation:
    links, joints, boxes = [Link("root")], [], []
    for key, entry in entries.items():
        make = Builder()
        for row in entry.get("rows") or entries[entry["rows_of"]]["rows"]:
            _add(make, *row)
        links.append(Link(key, float(entry["mass_kg"]), make.parts, make.boxes))
        joint, kind, on = entry["joint"]
        fields: dict[str, Any] = {k: float(entry[k]) for k in LIMITS if k in entry}
        fields |= {k: _floats(entry[k]) for k in ("xyz", "rpy", "axis") if k in entry}
        joints.append(Joint(joint, kind, on, key, **fields))
        up = _floats(entry.get("up", (0, 1, 0)))
        for area, center, half in entry.get("receptacles", ()):
            area = f"receptacle_aabb_{area}"
            boxes.append(Receptacle(area, _floats(center), _floats(half), up, key))
    return Articulation(name, parent, links, joints, boxes)


def _model(
    short: str,
    category: str,
    mass_kg: float,
    rows: list[Row],
    receptacles: Sequence[tuple[str, Row, Row]] = (),
    friction: float = FRICTION,
    centred: bool = True,
) -> ObjectModel:
    make = Builder()
    for row in rows:
        _add(make, *row)
    boxes = [free_box(name, *map(_floats, place)) for name, *place in receptacles]
    return finished(short, category, float(mass_kg), make, friction, boxes, centred=centred)


def _add(make: Builder, verb: str, *row: Any) -> None:
    options = row[-1] if isinstance(row[-1], dict) else {}
    given = row[:-1] if options else row
    if verb in ("flip", "mirror"):
        sign = np.where(np.arange(3) == shapes.AXES[given[0]], -1.0, 1.0)
        _add_all(make, given[1], lambda point: point * sign)
        if verb == "mirror":
            _add_all(make, given[1], lambda point: point)
    elif verb == "repeat":
        for k in range(given[0]):
            _add_all(make, given[2], lambda point, k=k: point + k * np.array(given[1]))
    elif verb in ("turn", "move"):
        _displace(make, verb, *given)
    elif verb == "vessel":
        outside, *rest = given
        if not isinstance(outside[0], list):
            outside = _curve(*outside)
        _add_vessel(make, _Vessel(outside, *rest, **options))
    elif verb == "see.span":
        make.span(*given, solid=False)
    elif verb.startswith("see."):
        make.see(*_visible(verb.removeprefix("see."), *given, **options))
    elif verb == "hit.box":
        make.boxes.append(Box(*given))
    elif verb.startswith("hit."):
        outline = outlines.rounded_rectangle(*given[0]) if verb == "hit.prism" else given[0]
        make.convexes.append(getattr(solids, verb.removeprefix("hit."))(outline, *given[1:]))
    else:
        getattr(make, verb)(*given, **options)


def _add_all(make: Builder, rows: list[Row], change: Callable[[Any], Any]) -> None:
    """Add rows whose points, their first argument, are changed; a span has two."""
    for verb, first, *rest in rows:
        if verb in ("mirror", "repeat"):
            inner = [(v, change(np.array(point)), *more) for v, point, *more in rest[-1]]
            _add(make, verb, first, *rest[:-1], inner)
        elif verb.endswith("span"):
            low, high = np.sort([change(np.array(first)), change(np.array(rest[0]))], axis=0)
            _add(make, verb, tuple(low), tuple(high), *rest[1:])
        else:
            _add(make, verb, change(np.array(first, float)), *rest)


def _displace(make: Builder, verb: str, *row: Any) -> None:
    *how, rows = row
    part = Builder()
    for inner in rows:
        _add(part, *inner)
    look, hit = (shapes.rotated, solids.rotated) if verb == "turn" else (shapes.moved, solids.moved)
    make.see(*(look(p, *how) for p in part.parts))
    make.convexes += [hit(s, *how) for s in part.solids()]


def _visible(
    name: str, first: Any, *rest: Any, bent: int | None = None, **options: Any
) -> list[Part]:
    if bent is not None:
        first = outlines.bent(first, bent)
    if name == "extruded":
        return outlines.extruded(outlines.rounded_rectangle(*first), *rest)
    made = outlines.slab if name == "slab" else getattr(shapes, name)
    return [made(first, *rest, **options)]


def _floats(values: Row) -> tuple[float, float, float]:
    x, y, z = values
    return float(x), float(y), float(z)


Chain = list[tuple[float, float]]


@dataclass(frozen=True)
class _Vessel:
    """The outside as (radius, height) in metres from the foot's edge to the rim, and its wall."""

    outside: Chain
    wall_m: float
    floor_m: float
    material: str
    lining: str
    pieces: int = 7
    sides: int = 24
    base_m: float = 0.0


def _curve(foot_m: float, rim_m: float, height_m: float, power: float, steps: int = 6) -> Chain:
    """Return an outside that bulges for powers below 1, is a cone at 1, and flares above."""
    share = np.linspace(0.0, 1.0, steps)
    return [(foot_m + (rim_m - foot_m) * float(t) ** power, height_m * float(t)) for t in share]


def _add_vessel(make: Builder, vessel: _Vessel) -> None:
    """Add the vessel's surfaces, its bottom, and a _ring of convex wall pieces."""
    out, wall, floor = vessel.outside, vessel.wall_m, vessel.floor_m
    inside, base_m = _inside(vessel), vessel.base_m
    rim = [out[-1], (out[-1][0] - wall / 2, out[-1][1] + wall / 2), inside[0]]
    place = (0.0, base_m, 0.0)
    make.see(
        shapes.lathe([[(0.0, 0.0), out[0]], out], vessel.material, vessel.sides, place),
        shapes.lathe([rim, inside], vessel.lining, vessel.sides, place),
    )
    make.convexes.append(
        solids.frustum(out[0][0], _radius_at(out, floor), base_m, base_m + floor, 16)
    )
    make.convexes += [solids.moved(piece, place) for piece in _walls(vessel)]


def _radius_at(chain: Chain, height_m: float) -> float:
    """Return the radius of a chain with rising heights."""
    return float(np.interp(height_m, [y for _, y in chain], [r for r, _ in chain]))


def _inside(vessel: _Vessel) -> Chain:
    wall, floor = vessel.wall_m, vessel.floor_m
    above = [(r - wall, y) for r, y in vessel.outside if y > floor * 1.2]
    low = (_radius_at(vessel.outside, floor) - wall, floor)
    return [*above[::-1], low, (0.0, floor)]


def _walls(vessel: _Vessel) -> list[Convex]:
    """Return wall pieces whose outside follows the bulge; their inside is a straight cone."""
    out, wall, floor = vessel.outside, vessel.wall_m, vessel.floor_m
    top = out[-1][1]
    outer: Chain = [(_radius_at(out, floor), floor), *((r, y) for r, y in out if y > floor * 1.2)]
    inner: Chain = [(outer[0][0] - wall, floor), (out[-1][0] - wall, top)]
    turn = 2 * np.pi / vessel.pieces
    return [
        solids.hull(
            np.vstack(
                [_ring(outer, np.array([0, 0.5, 1]) * turn), _ring(inner, np.array([0, turn]))]
            )
            @ shapes.rotation_matrix("y", -k * turn).T
        )
        for k in range(vessel.pieces)
    ]


def _ring(chain: Sequence[tuple[float, float]], angles_rad: Array) -> Array:
    """Return the points (N, 3) of a profile at the given angles about +y."""
    return np.array(
        [(r * np.cos(a), y, r * np.sin(a)) for a in angles_rad for r, y in chain], float
    )
