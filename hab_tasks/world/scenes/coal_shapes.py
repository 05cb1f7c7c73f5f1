"""Conversion of collision shapes to coal, for penetration depths and planning."""

from __future__ import annotations

import coal  # pyright: ignore[reportMissingImports]  # compiled, no stubs
import numpy as np
from numpy.typing import NDArray

from hab_tasks.privileged import Array, CollisionShape

CoalShape = tuple[coal.CollisionGeometry, Array]
"""A coal geometry and the (4, 4) pose ``shape_from_coal``."""

PLANE_HALF_SIZE_M = 5.0
"""Half size of the slab that replaces a plane; an infinite shape degrades the broad phase."""


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


def _hull(vertices_m: Array, faces: NDArray[np.int64]) -> coal.CollisionGeometry:
    points = coal.StdVec_Vec3s()
    for vertex in vertices_m:
        points.append(vertex)
    triangles = coal.StdVec_Triangle()
    for a, b, c in faces:
        triangles.append(coal.Triangle(int(a), int(b), int(c)))
    return coal.Convex(points, triangles)
