"""Ray casts against convex collision shapes."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from hab_tasks.privileged import Array, CollisionBody, CollisionShape
from hab_tasks.world.scenes.floor import body_points


def distance_along(shape: CollisionShape, points_m: Array, direction: Array) -> Array:
    """Returns the distance (K,) [m] of points (K, 3) to a convex shape along a direction (3,).

    Points and direction are in the body's frame; 0 inside the shape, inf without a hit.
    """
    normals, offsets = _planes(shape)
    if not len(normals):
        return np.full(len(points_m), np.inf)
    heights = points_m @ normals.T - offsets  # (K, F), positive outside the face
    slopes = normals @ direction
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = -heights / slopes
    entry = np.where(slopes < 0, crossing, -np.inf).max(axis=1)
    leave = np.where(slopes > 0, crossing, np.inf).min(axis=1)
    beside = ((slopes == 0) & (heights > 0)).any(axis=1)
    missed = beside | (entry > leave) | (leave < 0)
    return np.where(missed, np.inf, np.maximum(entry, 0.0))


@lru_cache(maxsize=8192)
def bounding_ball(body: CollisionBody) -> tuple[Array, float]:
    """Returns centre (3,) in the body's frame and radius [m] of a bounding sphere."""
    points = np.concatenate([body_points(shape)[:3] for shape in body.shapes], axis=1)
    centre = (points.min(axis=1) + points.max(axis=1)) / 2
    return centre, float(np.linalg.norm(points - centre[:, None], axis=0).max())


@lru_cache(maxsize=8192)
def _planes(shape: CollisionShape) -> tuple[Array, Array]:
    """Returns outward normals (F, 3) and offsets (F,) of a shape's faces, in the body's frame."""
    rotation, position = shape.body_from_shape[:3, :3], shape.body_from_shape[:3, 3]
    if shape.kind == "convex":
        a, b, c = (shape.vertices_m[shape.faces[:, i]] for i in range(3))
        normals = np.cross(b - a, c - a)
        length = np.linalg.norm(normals, axis=1)
        normals, a = (normals / length[:, None])[length > 0], a[length > 0]
        offsets = np.einsum("fi,fi->f", normals, a)
        inward = (normals @ shape.vertices_m.mean(axis=0)) > offsets
        normals, offsets = (
            np.where(inward[:, None], -normals, normals),
            np.where(inward, -offsets, offsets),
        )
    elif shape.kind == "plane":
        return np.zeros((0, 3)), np.zeros(0)
    else:
        half = shape.half_size_m
        if shape.kind in ("capsule", "cylinder"):
            half = np.array([half[0] + half[1], half[0], half[0]])
        elif shape.kind == "sphere":
            half = np.full(3, half[0])
        normals, offsets = np.concatenate((np.eye(3), -np.eye(3))), np.concatenate((half, half))
    turned = normals @ rotation.T
    return turned, offsets + turned @ position
