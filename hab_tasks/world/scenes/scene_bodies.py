"""Bodies of a scene by name, and their collision shapes as `privileged.CollisionBody`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import sapien
from mani_skill.utils.structs import Actor, Articulation
from sapien import physx

from hab_tasks.privileged import Array, CollisionBody, CollisionShape, ShapeKind
from hab_tasks.simulator import rigid_body, sapien_object
from hab_tasks.world.scenes.spec import SceneSpec


@dataclass(kw_only=True)
class SceneBodies:
    """Active bodies of a pool by name; `loose` and `static` ones belong to the layout."""

    spec: SceneSpec
    stage: Actor | None = None
    static: dict[str, Actor] = field(default_factory=dict)
    loose: dict[str, Actor] = field(default_factory=dict)
    articulations: dict[str, Articulation] = field(default_factory=dict)
    pickables: dict[str, Actor] = field(default_factory=dict)

    @property
    def movable(self) -> dict[str, Actor]:
        """All graspable objects: pickables first, then the layout's loose objects."""
        return {**self.pickables, **self.loose}


_NONE = np.zeros((0, 3))
_NO_FACES = np.zeros((0, 3), dtype=np.int64)


def matrix(pose: sapien.Pose) -> Array:
    """Returns a SAPIEN pose as a (4, 4) float64 matrix."""
    return pose.to_transformation_matrix().astype(np.float64)


def read_body(name: str, group: Any, component: Any) -> CollisionBody:
    """Reads the shapes of a rigid body component (first row's copy)."""
    shapes = tuple(_read_shape(shape) for shape in component.collision_shapes)
    return CollisionBody(name=name, group=group, shapes=shapes)


def components(scene_bodies: SceneBodies) -> Iterable[tuple[str, str, Any]]:
    """Yields (body name, group, component) of all bodies in the first row."""
    if scene_bodies.stage is not None:
        yield "stage", "stage", rigid_body(scene_bodies.stage)
    for name, actor in scene_bodies.static.items():
        yield name, "static", rigid_body(actor)
    for name, furniture in scene_bodies.articulations.items():
        for link in furniture.links:
            yield f"{name}/{link.name}", "furniture", sapien_object(link)
    for name, actor in scene_bodies.movable.items():
        yield name, "object", rigid_body(actor)


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
