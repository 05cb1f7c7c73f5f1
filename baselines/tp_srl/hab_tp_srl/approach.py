"""The sides from which the hand comes straight to a place: of a fridge, only from its front."""

from __future__ import annotations

from collections.abc import Sequence

import coal  # pyright: ignore[reportMissingImports]  # compiled, no stubs
import numpy as np
from hab_spa.planning.coal_model import coal_shapes
from hab_spa.shapes import Array
from numpy.typing import NDArray

from hab_tasks.privileged import PrivilegedState

Placed = tuple[coal.CollisionGeometry, coal.Transform3s]
"""A shape and its pose in the world."""

SIDES = 24
"""Number of horizontal directions that are tried."""

RADII_M = (0.09, 0.05)
LENGTH_M, RISE_M = 0.6, 0.06
"""The hand's way is a level capsule of this length, this far above the place. Its radius is the
second one if no side is open to the first."""


def open_sides(state: PrivilegedState, point_m: Array) -> NDArray[np.bool_]:
    """Returns the sides (SIDES,) from which no furniture or wall is in the hand's way.

    Args:
        state: The scene. Loose objects and the robot do not count.
        point_m: (3,) the place, in the world.
    """
    centre_m = point_m + np.array((0.0, 0.0, RISE_M))
    near = _shapes_near(state, centre_m)
    free = np.zeros(SIDES, dtype=bool)
    for radius_m in RADII_M:
        if not free.any():
            free = _free_of(near, centre_m, coal.Capsule(radius_m, LENGTH_M))
    return free


def faces_open_side(free: NDArray[np.bool_], poses: Array) -> NDArray[np.bool_]:
    """Whether base poses (K, 3) that face a place are on an open side of it, (K,)."""
    sides = np.round((poses[:, 2] + np.pi) / (2.0 * np.pi) * SIDES).astype(int)
    return free[sides % SIDES]


def _free_of(near: Sequence[Placed], centre_m: Array, capsule: coal.Capsule) -> NDArray[np.bool_]:
    """Returns the sides (SIDES,) to which a capsule from a point touches no shape."""
    free = np.ones(SIDES, dtype=bool)
    for side in range(SIDES):
        angle_rad = 2.0 * np.pi * side / SIDES
        ahead = np.array((np.cos(angle_rad), np.sin(angle_rad), 0.0))
        aside = np.array((-ahead[1], ahead[0], 0.0))
        # Coal's capsules lie along z.
        turn = np.column_stack((aside, (0.0, 0.0, 1.0), ahead))
        way = coal.Transform3s(turn, centre_m + (LENGTH_M / 2) * ahead)
        free[side] = not any(_touch(capsule, way, *shape) for shape in near)
    return free


def _shapes_near(state: PrivilegedState, centre_m: Array) -> list[Placed]:
    """Returns the shapes of furniture and walls around a point, with their poses."""
    ball, found = coal.Sphere(RADII_M[0] + LENGTH_M), []
    here = coal.Transform3s(np.eye(3), centre_m)
    for body in state.bodies:
        fixed = body.group != "robot" and body.name not in state.object_com_m
        if not fixed or body.name not in state.world_from_body:
            continue
        for shape, made in zip(body.shapes, coal_shapes(body), strict=True):
            pose = state.world_from_body[body.name] @ shape.body_from_shape @ made[1]
            placed = coal.Transform3s(pose[:3, :3], pose[:3, 3])
            if _touch(ball, here, made[0], placed):
                found.append((made[0], placed))
    return found


def _touch(
    shape: coal.CollisionGeometry,
    world_from_shape: coal.Transform3s,
    other: coal.CollisionGeometry,
    world_from_other: coal.Transform3s,
) -> bool:
    request, result = coal.CollisionRequest(), coal.CollisionResult()
    return bool(coal.collide(shape, world_from_shape, other, world_from_other, request, result))
