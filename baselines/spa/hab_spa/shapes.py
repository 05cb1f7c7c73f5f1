"""Bounds of the simulator's collision shapes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hab_tasks.privileged import CollisionBody, CollisionShape
from hab_tasks.world.scenes.coal_shapes import PLANE_HALF_SIZE_M

Array = NDArray[np.float64]


def invert_pose(a_from_b: Array) -> Array:
    """Returns ``b_from_a`` of rigid poses (..., 4, 4)."""
    b_from_a, turn = np.zeros_like(a_from_b), a_from_b[..., :3, :3].swapaxes(-1, -2)
    b_from_a[..., :3, :3], b_from_a[..., 3, 3] = turn, 1.0
    b_from_a[..., :3, 3] = -(turn @ a_from_b[..., :3, 3, None])[..., 0]
    return b_from_a


def standing(bases: Array, height_m: float) -> Array:
    """Returns the poses (..., 4, 4) of the base frame for base poses x, y [m], yaw [rad]."""
    cosine, sine = np.cos(bases[..., 2]), np.sin(bases[..., 2])
    world_from_base = np.zeros((*bases.shape[:-1], 4, 4))
    world_from_base[..., 0, 0] = world_from_base[..., 1, 1] = cosine
    world_from_base[..., 1, 0], world_from_base[..., 0, 1] = sine, -sine
    world_from_base[..., 2, 2] = world_from_base[..., 3, 3] = 1.0
    world_from_base[..., :2, 3], world_from_base[..., 2, 3] = bases[..., :2], height_m
    return world_from_base


def box_distance_m(points_m: Array, lower_m: Array, upper_m: Array) -> Array:
    """Returns the distances (...,) of points (..., 3) from boxes; 0 inside.

    Args:
        points_m: The points, each in the frame of its box.
        lower_m: Lower corners (..., 3).
        upper_m: Upper corners (..., 3).
    """
    return np.linalg.norm(points_m - np.clip(points_m, lower_m, upper_m), axis=-1)


def shape_bounds_m(shape: CollisionShape) -> tuple[Array, Array]:
    """Returns the corners (3,) [m] of a shape's bounding box in the shape's frame."""
    radius, half_length, _ = shape.half_size_m
    if shape.kind == "convex":
        return shape.vertices_m.min(axis=0), shape.vertices_m.max(axis=0)
    if shape.kind == "plane":
        half = np.full(3, PLANE_HALF_SIZE_M)
        return np.array([-2 * PLANE_HALF_SIZE_M, *-half[1:]]), np.array([0.0, *half[1:]])
    if shape.kind == "sphere":
        half = np.full(3, radius)
    elif shape.kind == "box":
        half = shape.half_size_m
    else:
        ends = radius if shape.kind == "capsule" else 0.0
        half = np.array([half_length + ends, radius, radius])
    return -half, half


def body_bounds_m(body: CollisionBody) -> tuple[Array, Array]:
    """Returns the corners (3,) [m] of a body's bounding box in the body's frame."""
    corners = []
    for shape in body.shapes:
        if shape.kind == "convex":
            points = shape.vertices_m
        else:
            bounds = np.stack(shape_bounds_m(shape))
            points = np.stack(np.meshgrid(*bounds.T), axis=-1).reshape(-1, 3)
        corners.append(points @ shape.body_from_shape[:3, :3].T + shape.body_from_shape[:3, 3])
    stacked = np.concatenate(corners)
    return stacked.min(axis=0), stacked.max(axis=0)


def within_body(body: CollisionBody, world_from_body: Array, points_m: Array) -> NDArray[np.bool_]:
    """Whether world points (K, 3) are inside the bounding box of a body at a pose (4, 4)."""
    lower, upper = body_bounds_m(body)
    body_from_world = invert_pose(world_from_body)
    local_m = points_m @ body_from_world[:3, :3].T + body_from_world[:3, 3]
    return np.all((lower <= local_m) & (local_m <= upper), axis=1)
