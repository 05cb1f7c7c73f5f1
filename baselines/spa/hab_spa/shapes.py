"""Collision shapes of the simulator as coal shapes, and their bounds."""

from __future__ import annotations

import coal  # pyright: ignore[reportMissingImports]  # compiled, no stubs
import numpy as np
from numpy.typing import NDArray

from hab_tasks.privileged import CollisionBody, CollisionShape

Array = NDArray[np.float64]
CoalShape = tuple[coal.CollisionGeometry, Array]
"""A coal geometry and the (4, 4) pose ``shape_from_coal``."""

PLANE_HALF_SIZE_M = 5.0
"""A plane is a thick slab of this half size: an endless shape would spoil the broad phase."""


def invert_pose(a_from_b: Array) -> Array:
    """Returns ``b_from_a`` of a rigid (4, 4) pose."""
    b_from_a = np.eye(4)
    b_from_a[:3, :3] = a_from_b[:3, :3].T
    b_from_a[:3, 3] = -a_from_b[:3, :3].T @ a_from_b[:3, 3]
    return b_from_a


def _hull(vertices_m: Array, faces: NDArray[np.int64]) -> coal.CollisionGeometry:
    points = coal.StdVec_Vec3s()
    for vertex in vertices_m:
        points.append(vertex)
    triangles = coal.StdVec_Triangle()
    for a, b, c in faces:
        triangles.append(coal.Triangle(int(a), int(b), int(c)))
    return coal.Convex(points, triangles)


def coal_shape(shape: CollisionShape) -> CoalShape:
    """Converts a shape; PhysX's capsules and cylinders lie along x, coal's along z."""
    shape_from_coal = np.eye(4)
    size = shape.half_size_m
    if shape.kind == "box":
        return coal.Box(*(2.0 * size)), shape_from_coal
    if shape.kind == "sphere":
        return coal.Sphere(float(size[0])), shape_from_coal
    if shape.kind == "convex":
        return _hull(shape.vertices_m, shape.faces), shape_from_coal
    if shape.kind == "plane":
        shape_from_coal[0, 3] = -PLANE_HALF_SIZE_M
        return coal.Box(*[2.0 * PLANE_HALF_SIZE_M] * 3), shape_from_coal
    shape_from_coal[:3, :3] = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]
    make = coal.Capsule if shape.kind == "capsule" else coal.Cylinder
    return make(float(size[0]), 2.0 * float(size[1])), shape_from_coal


def shape_bounds_m(shape: CollisionShape) -> tuple[Array, Array]:
    """Returns the lower and upper corners (3,) [m] of a shape's box in its own frame."""
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
    """Returns the corners (3,) [m] of the box around all shapes of a body, in the body's frame."""
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
