"""Overlaps of the bodies of a layout, by coal, and layouts in which pieces have moved.

What is computed of a body, a joint or a layout is kept: they never change, moved ones are new.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import coal  # pyright: ignore[reportMissingImports]  # compiled, no stubs
import numpy as np

from hab_tasks.privileged import Array
from hab_tasks.world.scenes.coal_shapes import coal_shape
from hab_tasks.world.scenes.layout_geometry import Joint, Layout, PosedBody, RigidShapes

_REQUEST = coal.CollisionRequest()
_REQUEST.enable_contact = True
_REQUEST.num_max_contacts = 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Extent:
    """Bounding boxes in the world of a body with K shapes.

    Attributes:
        low_m: (K, 3) lower corners of the shapes' boxes.
        high_m: (K, 3) upper corners.
        box_m: (2, 3) corners of the box around all of them; low above high without any shape.
    """

    low_m: Array
    high_m: Array
    box_m: Array


class Bodies:
    """Bodies with spatial search by bounding box.

    Attributes:
        all: The bodies.
        boxes_m: (N, 2, 3) the corners of their boxes.
    """

    def __init__(self, bodies: Iterable[PosedBody]) -> None:
        """Collects the boxes once."""
        self.all = tuple(bodies)
        self.boxes_m = np.array([extent(body).box_m for body in self.all]).reshape(-1, 2, 3)

    def near(self, box_m: Array) -> list[PosedBody]:
        """Returns the bodies whose boxes overlap a box (2, 3)."""
        meet = ((self.boxes_m[:, 0] < box_m[1]) & (box_m[0] < self.boxes_m[:, 1])).all(axis=1)
        return [self.all[index] for index in np.flatnonzero(meet)]


@lru_cache(maxsize=16384)
def extent(body: PosedBody) -> Extent:
    """Returns the bounding boxes of a body."""
    points, starts = body.points_m, body.shapes.starts
    if not len(starts):
        none = np.zeros((0, 3))
        return Extent(low_m=none, high_m=none, box_m=np.array([[np.inf] * 3, [-np.inf] * 3]))
    low = np.minimum.reduceat(points, starts, axis=1).T
    high = np.maximum.reduceat(points, starts, axis=1).T
    return Extent(low_m=low, high_m=high, box_m=np.array([low.min(axis=0), high.max(axis=0)]))


@lru_cache(maxsize=16384)
def solids(body: PosedBody) -> tuple[tuple[Any, Any], ...]:
    """Returns coal's geometry and world pose of each shape of a body."""
    poses = (body.world_from_body @ pose for _, pose in _geometries(body.shapes))
    placed = (coal.Transform3s(p[:3, :3].copy(), p[:3, 3].copy()) for p in poses)
    return tuple(zip((made for made, _ in _geometries(body.shapes)), placed, strict=True))


@lru_cache(maxsize=4096)
def _geometries(shapes: RigidShapes) -> tuple[tuple[Any, Array], ...]:
    """Returns coal's geometry of each shape, and its pose (4, 4) in the body."""
    made = [(shape, coal_shape(shape)) for shape in shapes.convex]
    return tuple((geometry, shape.body_from_shape @ pose) for shape, (geometry, pose) in made)


@lru_cache(maxsize=64)
def bodies_of(layout: Layout) -> Bodies:
    """Returns all bodies of a layout."""
    return Bodies(layout.placed.values())


def pieces_of(layout: Layout, pieces: Iterable[str]) -> Bodies:
    """Returns the bodies of some pieces (by name)."""
    wanted = set(pieces)
    return Bodies(body for body in layout.placed.values() if body.piece in wanted)


def rearranged(layout: Layout, motions: Mapping[str, Array]) -> Layout:
    """Returns a layout with some pieces (by name) moved rigidly, (4, 4) each."""
    placed = {
        name: body.moved(motions[body.piece]) if body.piece in motions else body
        for name, body in layout.placed.items()
    }
    joints = tuple(
        replace(
            joint,
            members=tuple(placed[body.name] for body in joint.members),
            world_from_joint=motions[joint.piece] @ joint.world_from_joint,
        )
        if joint.piece in motions
        else joint
        for joint in layout.joints
    )
    roots = {n: motions[n] @ root if n in motions else root for n, root in layout.roots.items()}
    return replace(layout, placed=placed, roots=roots, joints=joints)


@lru_cache(maxsize=4096)
def swept_boxes_m(joint: Joint) -> tuple[Array, ...]:
    """Returns the swept bounding box (2, 3) of each member over a joint's range."""
    return tuple(_swept_box_m(joint, body) for body in joint.members)


def _swept_box_m(joint: Joint, body: PosedBody) -> Array:
    if not len(body.shapes.starts):
        return extent(body).box_m
    local = np.linalg.inv(joint.world_from_joint)[:3] @ body.world_from_body @ body.shapes.points
    low, high = local.min(axis=1), local.max(axis=1)
    if joint.kind == "slide":
        low[0], high[0] = low[0] + joint.lower, high[0] + joint.upper
    else:
        radius = np.linalg.norm(local[1:], axis=0).max()
        low[1:], high[1:] = -radius, radius
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1)
    world = joint.world_from_joint[:3, :3] @ corners + joint.world_from_joint[:3, 3:]
    return np.array([world.min(axis=1), world.max(axis=1)])


def depth_m(first: PosedBody, second: PosedBody) -> float:
    """Returns the penetration depth [m] of two bodies: the maximum over pairs of convex shapes."""
    a, b = extent(first), extent(second)
    near = (a.low_m[:, None] < b.high_m) & (b.low_m < a.high_m[:, None])
    deepest = 0.0
    for i, j in np.argwhere(near.all(axis=2)):
        result = coal.CollisionResult()
        if coal.collide(*solids(first)[i], *solids(second)[j], _REQUEST, result):
            deepest = max(deepest, -result.getContact(0).penetration_depth)
    return deepest


def overlaps(movers: Bodies, others: Bodies) -> Iterator[tuple[PosedBody, PosedBody, float]]:
    """Yields pairs of a mover and an overlapping body of another piece, with the depth [m]."""
    for body in movers.all:
        for other in others.near(extent(body).box_m):
            depth = depth_m(body, other) if other.piece != body.piece else 0.0
            if depth > 0:
                yield body, other, depth


SINK_M = 0.008
"""Maximum penetration of a piece into a rug."""


def planar(start_m: Array, end_m: Array, turn_rad: float) -> Array:
    """Returns the (4, 4) motion that turns about `start_m` (2,) and takes it to `end_m` (2,)."""
    cosine, sine = math.cos(turn_rad), math.sin(turn_rad)
    motion = np.eye(4)
    motion[:2, :2] = [[cosine, -sine], [sine, cosine]]
    motion[:2, 3] = end_m - motion[:2, :2] @ start_m
    return motion


def settled(own: Iterable[PosedBody], motion: Array, rugs: Bodies, sink_m: float = SINK_M) -> Array:
    """Adjusts the height of a motion (4, 4) so that a piece stands on the rug or floor below it.

    Args:
        own: The bodies of the piece at its old pose.
        motion: The motion to its new pose.
        rugs: Rugs and mats.
        sink_m: Maximum penetration into rugs.
    """
    own = tuple(own)
    low = min(extent(body).box_m[0, 2] for body in own)
    carrying = [
        flat
        for flat in _met(own, _lifted(np.eye(4), -sink_m), rugs)
        if abs(low - extent(flat).box_m[1, 2]) < sink_m
    ]
    lowered = -max((extent(flat).box_m[1, 2] for flat in carrying), default=0.0)
    met = _met(own, _lifted(motion, lowered), rugs)
    if any(flat in carrying for flat in met):
        return motion
    # Hulls of soft objects may extend below the floor; they are not lifted.
    bottom = max(low + lowered, 0.0)
    raised = max((extent(flat).box_m[1, 2] - sink_m - bottom for flat in met), default=0.0)
    return _lifted(motion, lowered + max(raised, 0.0))


def _met(own: Iterable[PosedBody], motion: Array, rugs: Bodies) -> list[PosedBody]:
    """Returns the rugs that a piece overlaps after a motion."""
    moved = Bodies(body.moved(motion) for body in own)
    return [flat for _, flat, _ in overlaps(moved, rugs)]


def _lifted(motion: Array, height_m: float) -> Array:
    """Returns a planar motion (4, 4) that also lifts."""
    lifted = motion.copy()
    lifted[2, 3] = height_m
    return lifted
