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
