"""Collision geometry of a layout without a running simulator: posed convex shapes, open joints.

The shapes are exactly those of the engine. They are read once per template, so other arrangements
of the same furniture only change their poses.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from hab_tasks.geometry import IDENTITY, to_matrix
from hab_tasks.privileged import Array, CollisionShape
from hab_tasks.simulator import rigid_body, sapien_object
from hab_tasks.world.scenes.build import BodyBuilder
from hab_tasks.world.scenes.floor import body_points, footprints
from hab_tasks.world.scenes.physics import bare_scene
from hab_tasks.world.scenes.pool import matrix, read_body
from hab_tasks.world.scenes.spec import ArticulationInstance, ObjectTemplate, SceneSpec, Stage

STAGE = "stage"
"""Name of the stage mesh's piece (floor and walls); each of its parts is a separate body."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RigidShapes:
    """The convex shapes of one body in its own frame.

    Attributes:
        convex: K shapes.
        points: (4, P) homogeneous corners of all shapes.
        starts: (K,) index of each shape's first corner.
    """

    convex: tuple[CollisionShape, ...]
    points: Array
    starts: NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, eq=False)
class PosedBody:
    """A body at a pose in the world.

    Attributes:
        name: As in the simulator: an object's name, ``furniture/link``; ``stage/3``.
        piece: Name of the object or furniture that it belongs to, ``stage`` for the stage.
    """

    name: str
    piece: str
    shapes: RigidShapes
    world_from_body: Array

    @property
    def points_m(self) -> Array:
        """(3, P) corners of all shapes in the world."""
        return self.world_from_body[:3] @ self.shapes.points

    @cached_property
    def outlines_m(self) -> tuple[Array, ...]:
        """Outlines (V, 2) on the floor of the shapes that block the base."""
        prints = footprints(self.points_m, self.shapes.starts)
        return tuple(f.outline_m for f in prints if f.in_the_way())

    def moved(self, motion: Array) -> PosedBody:
        """Returns the body after a rigid motion (4, 4) of the world."""
        return replace(self, world_from_body=motion @ self.world_from_body)


@dataclass(frozen=True, kw_only=True, eq=False)
class Joint:
    """A movable joint of furniture, closed at 0.

    Attributes:
        members: The bodies that move with it, closed.
        world_from_joint: (4, 4) its frame while everything is closed; the axis is x.
        lower: Limit [m or rad].
        upper: Limit [m or rad].
        rank: Number of movable joints between it and the root.
    """

    piece: str
    name: str
    kind: Literal["slide", "hinge"]
    members: tuple[PosedBody, ...]
    world_from_joint: Array
    lower: float
    upper: float
    rank: int

    def motion(self, value: float) -> Array:
        """Returns the (4, 4) motion that opens it from 0 to `value` [m or rad]."""
        local = np.eye(4)
        if self.kind == "slide":
            local[0, 3] = value
        else:
            cosine, sine = np.cos(value), np.sin(value)
            local[1:3, 1:3] = [[cosine, -sine], [sine, cosine]]
        return self.world_from_joint @ local @ np.linalg.inv(self.world_from_joint)


@dataclass(frozen=True, kw_only=True, eq=False)
class Layout:
    """A layout's bodies, all doors and drawers closed.

    Attributes:
        spec: The layout as loaded.
        placed: Body name -> body at its current pose.
        roots: Name of articulated furniture -> current pose (4, 4) of its root.
    """

    spec: SceneSpec
    placed: dict[str, PosedBody]
    roots: dict[str, Array]
    joints: tuple[Joint, ...]

    @staticmethod
    def of(spec: SceneSpec) -> Layout:
        """Returns the geometry of a layout."""
        placed: dict[str, PosedBody] = {}
        joints: list[Joint] = []
        roots = {item.name: to_matrix(item.world_from_root) for item in spec.articulations}
        world_from_stage = to_matrix(spec.stage.world_from_stage)
        for index, shapes in enumerate(_stage_shapes(spec.stage)):
            name = f"{STAGE}/{index}"
            placed[name] = _posed(name, STAGE, shapes, world_from_stage)
        for item in spec.objects:
            shapes = _object_shapes(item.template, item.scale)
            pose = to_matrix(item.world_from_object)
            placed[item.name] = _posed(item.name, item.name, shapes, pose)
        for item in spec.articulations:
            model = furniture_model(replace(item, name=item.template, world_from_root=IDENTITY))
            world_from_root = roots[item.name]
            for link in model.links:
                name, pose = f"{item.name}/{link.name}", world_from_root @ link.world_from_body
                placed[name] = _posed(name, item.name, link.shapes, pose)
            for joint in model.joints:
                members = tuple(placed[f"{item.name}/{link.name}"] for link in joint.members)
                pose = world_from_root @ joint.world_from_joint
                joints.append(
                    replace(joint, piece=item.name, members=members, world_from_joint=pose)
                )
        return Layout(spec=spec, placed=placed, roots=roots, joints=tuple(joints))

    def opened(self, values: Mapping[tuple[str, str], float]) -> dict[str, PosedBody]:
        """Returns all bodies with some joints open: (piece, joint) -> [m or rad]."""
        placed = dict(self.placed)
        for joint in sorted(self.joints, key=lambda j: -j.rank):
            value = values.get((joint.piece, joint.name), 0.0)
            if value:
                motion = joint.motion(value)
                placed |= {body.name: placed[body.name].moved(motion) for body in joint.members}
        return placed


@dataclass(frozen=True, kw_only=True, eq=False)
class FurnitureModel:
    """Articulated furniture by itself; links have their bare names."""

    links: tuple[PosedBody, ...]
    joints: tuple[Joint, ...]


@lru_cache(maxsize=1024)
def _object_shapes(template: ObjectTemplate, scale: float) -> RigidShapes:
    actor = BodyBuilder(bare_scene()).static("object", template, IDENTITY, scale)
    return _rigid(read_body("object", "static", rigid_body(actor)).shapes)


@lru_cache(maxsize=64)
def _stage_shapes(stage: Stage) -> tuple[RigidShapes, ...]:
    actor = BodyBuilder(bare_scene()).stage(stage)
    return tuple(_rigid([s]) for s in read_body("stage", "stage", rigid_body(actor)).shapes)


@lru_cache(maxsize=256)
def furniture_model(instance: ArticulationInstance) -> FurnitureModel:
    """Returns articulated furniture at the pose of its instance."""
    built = BodyBuilder(bare_scene()).articulation(instance, 1)
    engine: Any = sapien_object(built)
    engine.set_qpos(np.zeros(engine.dof, dtype=np.float32))  # updates the links' poses
    links = [(link.name, sapien_object(link)) for link in built.links]
    placed: dict[Any, PosedBody] = {}
    for name, link in links:
        shapes = _rigid(read_body(name, "furniture", link).shapes)
        placed[link] = _posed(name, "", shapes, matrix(link.entity_pose))
    joints = [_joint(j.name, sapien_object(j).child_link, placed) for j in built.active_joints]
    return FurnitureModel(links=tuple(placed.values()), joints=tuple(joints))


def _joint(name: str, link: Any, placed: Mapping[Any, PosedBody]) -> Joint:
    lower, upper = (float(x) for x in link.joint.limits[0])
    return Joint(
        piece="",
        name=name,
        kind="slide" if link.joint.type == "prismatic" else "hinge",
        members=tuple(body for x, body in placed.items() if link in (x, *_ancestors(x))),
        world_from_joint=matrix(link.entity_pose * link.joint.pose_in_child),
        lower=max(lower, -math.pi),
        upper=min(upper, math.pi),
        rank=sum(x.joint.dof for x in _ancestors(link)),
    )


def _ancestors(link: Any) -> list[Any]:
    found = []
    while (link := link.parent) is not None:
        found.append(link)
    return found


def _posed(name: str, piece: str, shapes: RigidShapes, world_from_body: Array) -> PosedBody:
    return PosedBody(name=name, piece=piece, shapes=shapes, world_from_body=world_from_body)


def _rigid(shapes: Iterable[CollisionShape]) -> RigidShapes:
    convex = tuple(shapes)
    corners = [body_points(shape) for shape in convex]
    counts = [points.shape[1] for points in corners]
    return RigidShapes(
        convex=convex,
        points=np.concatenate(corners, axis=1) if corners else np.zeros((4, 0)),
        starts=np.cumsum([0, *counts[:-1]]) if counts else np.zeros(0, dtype=np.int64),
    )
