"""Movable pieces of a layout, the objects that move with them, and their back sides.

All of it is derived from the geometry, so that datasets need no annotation. Objects on a piece move
with it; wall-mounted, leaning and flat objects do not move, nor does the kitchen.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import coal  # pyright: ignore[reportMissingImports]  # compiled, no stubs
import numpy as np

from hab_authoring.layouts.overlaps import depth_m, extent, pieces_of, solids
from hab_authoring.layouts.standing import ROOM_DOORS
from hab_tasks.articulations import FRIDGES
from hab_tasks.geometry import to_matrix
from hab_tasks.privileged import Array
from hab_tasks.world.scenes.build import FLAT_HEIGHT_M
from hab_tasks.world.scenes.layout_geometry import STAGE, Layout, PosedBody

COUNTER, CUPBOARD = "kitchen_counter", "kitchenCupboard_01"
FIXED_TEMPLATES = (*FRIDGES, COUNTER, CUPBOARD, *ROOM_DOORS)
"""Templates with a fixed pose in each macro layout."""

FLOOR_GAP_M = 0.25
"""Maximum height of the lowest shape of a piece on the floor, as thin legs have no shapes."""

SUPPORT_GAP_M = 0.03
"""Maximum gap between an object and the surface that supports it."""

LEANING_COS = np.cos(np.radians(15.0))
WALL_GAP_M = 0.35
"""Maximum distance between a wall and the side of a piece that stands against it."""

CLOSE_M = 0.15
"""Maximum distance for a piece that stands against a wall with its short side."""

SEAT_SHARE = 0.24
"""Offset from the centre, as a share of the half depth, from which a surface counts as a seat with
a backrest."""

SHARED_SHARE = 0.1
"""Share of a piece's outline under another piece from which it moves with that piece."""

FURNITURE_SIZE_M, FURNITURE_HEIGHT_M = 0.35, 0.3
"""Minimum length and height of pieces that swap positions."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Piece:
    """A free-standing piece of furniture with the objects that move with it.

    Attributes:
        name: Handle.
        members: Handles of all objects that move with it, itself first.
        center_m: (2,) centre of its outline on the floor.
        back: (2,) unit vector towards its back.
        half_m: Half extents of its outline along `back` and across.
        wall_gap_m: Distance from its back to a wall; None when it stands free.
        swappable: Whether it is large enough to swap positions with others.
    """

    name: str
    template: str
    members: tuple[str, ...]
    center_m: Array
    back: Array
    half_m: tuple[float, float]
    wall_gap_m: float | None
    swappable: bool


@dataclass(frozen=True, kw_only=True)
class _Side:
    """One side of a piece's outline: outward direction, distance from the middle, half length."""

    normal: tuple[float, float]
    half_m: float
    half_length_m: float


def find_pieces(layout: Layout, fixed: Collection[str] = FIXED_TEMPLATES) -> list[Piece]:
    """Returns the movable pieces of a layout, in the layout's order.

    Args:
        layout: The layout.
        fixed: Templates that are not moved. If the kitchen counter is not among them, the cupboard
            above it moves with it.
    """
    bodies: dict[str, list[PosedBody]] = {}
    for body in layout.placed.values():
        bodies.setdefault(body.piece, []).append(body)
    templates = {item.name: item.template.name for item in layout.spec.objects}
    templates |= {item.name: item.template for item in layout.spec.articulations}
    carriers = _carriers(bodies)
    counter = next((n for n, t in templates.items() if t == COUNTER and t not in fixed), None)
    if counter is not None:
        carriers |= {name: counter for name, t in templates.items() if t == CUPBOARD}
    standing = [
        name
        for name in templates
        if name not in carriers
        and templates[name] not in fixed
        and _stands(layout, name, bodies[name])
    ]
    boxes = {name: _outline_box(layout, name, bodies[name]) for name in standing}
    carriers |= _pushed_under(boxes)
    pieces = []
    for name in standing:
        if name not in carriers:
            carried = [other for other in templates if _root(other, carriers) == name]
            members = (name, *(other for other in carried if other != name))
            pieces.append(_piece(layout, name, templates[name], members, bodies[name], boxes[name]))
    return pieces


def flat_bodies(layout: Layout) -> list[PosedBody]:
    """Returns rugs and mats."""
    return [
        body
        for body in layout.placed.values()
        if body.piece != STAGE
        and len(body.shapes.starts)
        and extent(body).box_m[1, 2] < FLAT_HEIGHT_M
    ]


def _carriers(bodies: Mapping[str, list[PosedBody]]) -> dict[str, str]:
    """Returns object -> the piece that supports it, for objects that are not on the floor."""
    lowered = np.eye(4)
    lowered[2, 3] = -SUPPORT_GAP_M
    found = {}
    for name, own in bodies.items():
        box = _box(own)
        if name == STAGE or box[1, 2] < FLAT_HEIGHT_M:
            continue
        deepest = SUPPORT_GAP_M / 3
        for other, theirs in bodies.items():
            low, high = _box(theirs)
            middle = box.mean(axis=0)
            over = (low[:2] < middle[:2]).all() and (middle[:2] < high[:2]).all()
            if other in (name, STAGE) or not over or high[2] < FLAT_HEIGHT_M or low[2] > box[0, 2]:
                continue
            gain = max(
                depth_m(a.moved(lowered), b) - depth_m(a, b)
                for a in own
                for b in theirs
            )  # fmt: skip
            if gain > deepest:
                deepest, found[name] = gain, other
    return found


def _stands(layout: Layout, name: str, own: list[PosedBody]) -> bool:
    """Whether an object stands upright on the floor rather than lying flat."""
    low, high = _box(own)
    if not high[2] > FLAT_HEIGHT_M:
        return False
    for item in layout.spec.objects:
        if item.name == name:
            up = to_matrix(item.world_from_object)[:3, :3] @ item.template.up
            return bool(low[2] < FLOOR_GAP_M and up[2] > LEANING_COS)
    return bool(low[2] < FLOOR_GAP_M)


def _piece(
    layout: Layout,
    name: str,
    template: str,
    members: tuple[str, ...],
    own: list[PosedBody],
    box: tuple[Array, list[_Side]],
) -> Piece:
    center, sides = box
    walls = _walls(layout, own, center, sides)
    front = _front(layout, name, own, center, sides)
    behind = [i for i, (gap, _) in walls.items() if gap < CLOSE_M or _is_long(sides[i])]
    if front is not None:
        back = sides[(front + 2) % 4]
    elif behind:
        back = max((sides[i] for i in behind), key=lambda side: side.half_length_m)
    else:
        back = min(sides, key=lambda side: side.half_m)
    wall = walls.get(sides.index(back))
    low, high = _box(own)
    size = 2 * max(back.half_m, back.half_length_m)
    return Piece(
        name=name,
        template=template,
        members=members,
        center_m=center,
        back=wall[1] if wall else np.array(back.normal),
        half_m=(back.half_m, back.half_length_m),
        wall_gap_m=wall[0] if wall else None,
        swappable=bool(size > FURNITURE_SIZE_M and high[2] - low[2] > FURNITURE_HEIGHT_M),
    )


def _outline_box(layout: Layout, name: str, own: list[PosedBody]) -> tuple[Array, list[_Side]]:
    """Returns the centre (2,) of a piece's outline and its four sides, counter-clockwise."""
    poses = {item.name: item.world_from_object for item in layout.spec.objects}
    poses |= {item.name: item.world_from_root for item in layout.spec.articulations}
    level = to_matrix(poses[name])[:2, :3]
    axis = level[:, int(np.argmax(np.linalg.norm(level, axis=0)))]
    axis = axis / np.linalg.norm(axis)
    axes = np.stack((axis, (-axis[1], axis[0])))
    points = axes @ np.concatenate([body.points_m[:2] for body in own], axis=1)
    low, high = points.min(axis=1), points.max(axis=1)
    half = (high - low) / 2
    sides = [
        _Side(
            normal=tuple(sign * axes[i]),
            half_m=float(half[i]),
            half_length_m=float(half[1 - i]),
        )
        for sign in (1.0, -1.0)
        for i in (0, 1)
    ]
    return (low + high) / 2 @ axes, sides


def _walls(
    layout: Layout, own: list[PosedBody], center: Array, sides: list[_Side]
) -> dict[int, tuple[float, Array]]:
    """Returns side -> distance to the wall there and its inward normal turned round (2,)."""
    low, high = _box(own)
    bottom, top = low[2] + 0.15, max(high[2], low[2] + 0.4)
    pose = np.eye(3)
    pose[:2, 0], pose[:2, 1] = sides[0].normal, sides[1].normal
    at = coal.Transform3s(pose, np.array([*center, (bottom + top) / 2]))
    found: dict[int, tuple[float, Array]] = {}
    for wall in pieces_of(layout, [STAGE]).all:
        for axis in (0, 1):
            # Narrower, so that the end of a wall beside the piece does not count as behind it.
            half = [side.half_m * (1.0 if i == axis else 0.8) for i, side in enumerate(sides[:2])]
            probe = coal.Box(2 * half[0], 2 * half[1], top - bottom)
            result = coal.DistanceResult()
            gap = coal.distance(probe, at, *solids(wall)[0], coal.DistanceRequest(), result)
            normal = np.asarray(result.normal)[:2]
            length = np.linalg.norm(normal)
            for index in (axis, axis + 2):
                nearest = found[index][0] if index in found else WALL_GAP_M
                if gap < nearest and length > 0.98 and normal @ sides[index].normal > 0.97:
                    found[index] = (float(gap), normal / length)
    return found


def _front(
    layout: Layout, name: str, own: list[PosedBody], center: Array, sides: list[_Side]
) -> int | None:
    """Returns the side with doors and drawers, or the seat's side; None without either."""
    doors = [body for joint in layout.joints if joint.piece == name for body in joint.members]
    seats = [
        layout.placed[r.body].world_from_body @ np.append(r.body_from_box[:3], 1.0)
        for r in layout.spec.receptacles
        if r.body == name
    ]
    if not doors and not seats:
        return None
    middle = _box(doors).mean(axis=0) if doors else np.mean(seats, axis=0)
    offsets = [(middle[:2] - center) @ side.normal / side.half_m for side in sides]
    front = int(np.argmax(offsets))
    return front if doors or offsets[front] > SEAT_SHARE else None


def _is_long(side: _Side) -> bool:
    return side.half_length_m > 0.9 * side.half_m


def _pushed_under(boxes: Mapping[str, tuple[Array, list[_Side]]]) -> dict[str, str]:
    """Returns piece -> the larger piece above it, e.g. a table above its chair."""
    grid = np.stack(np.meshgrid(*[np.linspace(-0.95, 0.95, 12)] * 2), axis=-1).reshape(-1, 2)
    area = {name: sides[0].half_m * sides[1].half_m for name, (_, sides) in boxes.items()}
    found = {}
    for name, (center, sides) in boxes.items():
        own = center + grid @ np.stack(
            [sides[i].half_m * np.array(sides[i].normal) for i in (0, 1)]
        )
        for other, (middle, theirs) in boxes.items():
            if area[other] <= area[name]:
                continue
            inside = np.ones(len(own), dtype=bool)
            for side in theirs:
                inside &= (own - middle) @ side.normal < side.half_m
            if inside.mean() > SHARED_SHARE:
                found[name] = other
    return found


def _root(name: str, carriers: Mapping[str, str]) -> str:
    """Follows what carries what down to the floor."""
    seen = {name}
    while name in carriers and carriers[name] not in seen:
        name = carriers[name]
        seen.add(name)
    return name


def _box(own: list[PosedBody]) -> Array:
    boxes = np.stack([extent(body).box_m for body in own])
    return np.stack((boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)))
