"""Collision shapes as the physics engine holds them -> `privileged.CollisionBody`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import sapien
from sapien import physx

from hab_tasks.privileged import Array, CollisionBody, CollisionShape, ShapeKind
from hab_tasks.scenes.handles import SceneHandles

_NONE = np.zeros((0, 3))
_NO_FACES = np.zeros((0, 3), dtype=np.int64)


def matrix(pose: sapien.Pose) -> Array:
    """Returns a SAPIEN pose as a (4, 4) float64 matrix."""
    return pose.to_transformation_matrix().astype(np.float64)


def read_body(name: str, group: Any, component: Any) -> CollisionBody:
    """Reads the shapes of a rigid body component (first row's copy)."""
    shapes = tuple(_read_shape(shape) for shape in component.collision_shapes)
    return CollisionBody(name=name, group=group, shapes=shapes)


def components(handles: SceneHandles) -> Iterable[tuple[str, str, Any]]:
    """Yields (body name, group, component) of everything built, for the handles' first row."""
    if handles.stage is not None:
        yield "stage", "stage", handles.stage._bodies[0]
    for name, actor in handles.static.items():
        yield name, "static", actor._bodies[0]
    for name, furniture in handles.articulations.items():
        for link in furniture.links:
            yield f"{name}/{link.name}", "furniture", link._objs[0]
    for name, actor in handles.movable.items():
        yield name, "object", actor._bodies[0]


def distance_along(shape: CollisionShape, points_m: Array, direction: Array) -> Array:
    """Returns how far (K,) [m] each point (K, 3) is from a convex shape along a direction (3,).

    Points and direction are in the body's frame; 0 inside the shape, inf where it is never met.
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
        return _NONE, np.zeros(0)
    else:
        half = shape.half_size_m
        if shape.kind in ("capsule", "cylinder"):
            half = np.array([half[0] + half[1], half[0], half[0]])
        elif shape.kind == "sphere":
            half = np.full(3, half[0])
        normals, offsets = np.concatenate((np.eye(3), -np.eye(3))), np.concatenate((half, half))
    turned = normals @ rotation.T
    return turned, offsets + turned @ position


def _read_shape(shape: Any) -> CollisionShape:
    kind: ShapeKind = "convex"
    half, vertices, faces = np.zeros(3), _NONE, _NO_FACES
    if isinstance(shape, physx.PhysxCollisionShapeBox):
        kind, half = "box", np.asarray(shape.half_size, dtype=float)
    elif isinstance(shape, physx.PhysxCollisionShapeSphere):
        kind, half = "sphere", np.array([shape.radius, 0.0, 0.0])
    elif isinstance(shape, physx.PhysxCollisionShapeCapsule):
        kind, half = "capsule", np.array([shape.radius, shape.half_length, 0.0])
    elif isinstance(shape, physx.PhysxCollisionShapeCylinder):
        kind, half = "cylinder", np.array([shape.radius, shape.half_length, 0.0])
    elif isinstance(shape, physx.PhysxCollisionShapePlane):
        kind = "plane"
    else:
        vertices = np.asarray(shape.vertices, dtype=float) * np.asarray(shape.scale, dtype=float)
        faces = np.asarray(shape.triangles, dtype=np.int64).reshape(-1, 3)
    return CollisionShape(
        kind=kind,
        body_from_shape=matrix(shape.local_pose),
        half_size_m=half,
        vertices_m=vertices,
        faces=faces,
    )
