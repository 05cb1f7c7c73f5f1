"""Collision geometry of a layout without a running simulator: posed convex shapes, overlaps.

The shapes are exactly those of the engine. They are read once per template, so other arrangements
of the same furniture only change their poses.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Literal

import coal  # pyright: ignore[reportMissingImports]  # compiled, no stubs
import numpy as np
from numpy.typing import NDArray

from hab_tasks.geometry import IDENTITY, to_matrix
from hab_tasks.privileged import Array, CollisionShape
from hab_tasks.scenes.build import BodyBuilder
from hab_tasks.scenes.coal_shapes import coal_shape
from hab_tasks.scenes.floor import body_points, footprints
from hab_tasks.scenes.physics import bare_scene
from hab_tasks.scenes.shapes import matrix, read_body
from hab_tasks.scenes.spec import ArticulationInstance, ObjectTemplate, SceneSpec, Stage
from hab_tasks.simulator import rigid_body, sapien_object

STAGE = "stage"
"""Name of the stage mesh's piece (floor and walls); each of its parts is a separate body."""

_REQUEST = coal.CollisionRequest()
_REQUEST.enable_contact = True
_REQUEST.num_max_contacts = 1


@dataclass(frozen=True, kw_only=True, eq=False)
class RigidShapes:
    """The convex shapes of one body in its own frame.

    Attributes:
        geometries: K coal shapes.
        body_from_shape: (K, 4, 4) their poses.
        points: (4, P) homogeneous corners of all shapes.
        starts: (K,) index of each shape's first corner.
    """

    geometries: tuple[Any, ...]
    body_from_shape: Array
    points: Array
    starts: NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, eq=False)
class PosedBody:
    """A body at a pose in the world.

    Attributes:
        name: As in the simulator: an object's name, ``furniture/link``; ``stage/3``.
        piece: Name of the object or furniture that it belongs to, ``stage`` for the stage.
        low_m: (K, 3) lower corners of the shapes' boxes in the world.
        high_m: (K, 3) upper corners.
        box_m: (2, 3) corners of the box around all of them; low above high without any shape.
        world_from_shape: K poses as coal takes them.
    """

    name: str
    piece: str
    shapes: RigidShapes
    world_from_body: Array
    low_m: Array
    high_m: Array
    box_m: Array
    world_from_shape: tuple[Any, ...]

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
        return pose_body(self.name, self.piece, self.shapes, motion @ self.world_from_body)


def pose_body(name: str, piece: str, shapes: RigidShapes, world_from_body: Array) -> PosedBody:
    """Poses a body's shapes (4, 4)."""
    points = world_from_body[:3] @ shapes.points
    poses = world_from_body @ shapes.body_from_shape
    low, high = np.zeros((0, 3)), np.zeros((0, 3))
    box = np.array([[np.inf] * 3, [-np.inf] * 3])
    if len(poses):
        low = np.minimum.reduceat(points, shapes.starts, axis=1).T
        high = np.maximum.reduceat(points, shapes.starts, axis=1).T
        box = np.array([low.min(axis=0), high.max(axis=0)])
    return PosedBody(
        name=name,
        piece=piece,
        shapes=shapes,
        world_from_body=world_from_body,
        low_m=low,
        high_m=high,
        box_m=box,
        world_from_shape=tuple(coal.Transform3s(p[:3, :3].copy(), p[:3, 3].copy()) for p in poses),
    )


class Bodies:
    """Bodies with spatial search by bounding box.

    Attributes:
        all: The bodies.
        boxes_m: (N, 2, 3) the corners of their boxes.
    """

    def __init__(self, bodies: Iterable[PosedBody]) -> None:
        """Collects the boxes once."""
        self.all = tuple(bodies)
        self.boxes_m = np.array([body.box_m for body in self.all]).reshape(-1, 2, 3)

    def near(self, box_m: Array) -> list[PosedBody]:
        """Returns the bodies whose boxes overlap a box (2, 3)."""
        meet = ((self.boxes_m[:, 0] < box_m[1]) & (box_m[0] < self.boxes_m[:, 1])).all(axis=1)
        return [self.all[index] for index in np.flatnonzero(meet)]


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

    @cached_property
    def swept_boxes_m(self) -> tuple[Array, ...]:
        """Swept bounding box (2, 3) of each member over the joint's range."""
        return tuple(self._swept_box_m(body) for body in self.members)

    def _swept_box_m(self, body: PosedBody) -> Array:
        if not len(body.low_m):
            return body.box_m
        local = np.linalg.inv(self.world_from_joint)[:3] @ body.world_from_body @ body.shapes.points
        low, high = local.min(axis=1), local.max(axis=1)
        if self.kind == "slide":
            low[0], high[0] = low[0] + self.lower, high[0] + self.upper
        else:
            radius = np.linalg.norm(local[1:], axis=0).max()
            low[1:], high[1:] = -radius, radius
        corners = np.stack(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1)
        world = self.world_from_joint[:3, :3] @ corners + self.world_from_joint[:3, 3:]
        return np.array([world.min(axis=1), world.max(axis=1)])


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

    @cached_property
    def bodies(self) -> Bodies:
        """All bodies."""
        return Bodies(self.placed.values())

    def of_pieces(self, pieces: Iterable[str]) -> Bodies:
        """Returns the bodies of some pieces (by name)."""
        wanted = set(pieces)
        return Bodies(body for body in self.placed.values() if body.piece in wanted)

    @staticmethod
    def of(spec: SceneSpec) -> Layout:
        """Returns the geometry of a layout."""
        placed: dict[str, PosedBody] = {}
        joints: list[Joint] = []
        roots = {item.name: to_matrix(item.world_from_root) for item in spec.articulations}
        world_from_stage = to_matrix(spec.stage.world_from_stage)
        for index, shapes in enumerate(_stage_shapes(spec.stage)):
            name = f"{STAGE}/{index}"
            placed[name] = pose_body(name, STAGE, shapes, world_from_stage)
        for item in spec.objects:
            shapes = _object_shapes(item.template, item.scale)
            pose = to_matrix(item.world_from_object)
            placed[item.name] = pose_body(item.name, item.name, shapes, pose)
        for item in spec.articulations:
            model = _furniture(item.urdf_file, item.scale)
            world_from_root = roots[item.name]
            for link in model.links:
                name, pose = f"{item.name}/{link.name}", world_from_root @ link.world_from_body
                placed[name] = pose_body(name, item.name, link.shapes, pose)
            for joint in model.joints:
                members = tuple(placed[f"{item.name}/{link.name}"] for link in joint.members)
                pose = world_from_root @ joint.world_from_joint
                joints.append(
                    replace(joint, piece=item.name, members=members, world_from_joint=pose)
                )
        return Layout(spec=spec, placed=placed, roots=roots, joints=tuple(joints))

    def moved(self, motions: Mapping[str, Array]) -> Layout:
        """Returns the layout with some pieces (by name) moved rigidly, (4, 4) each."""
        placed = {
            name: body.moved(motions[body.piece]) if body.piece in motions else body
            for name, body in self.placed.items()
        }
        joints = tuple(
            replace(
                joint,
                members=tuple(placed[body.name] for body in joint.members),
                world_from_joint=motions[joint.piece] @ joint.world_from_joint,
            )
            if joint.piece in motions
            else joint
            for joint in self.joints
        )
        roots = {n: motions[n] @ root if n in motions else root for n, root in self.roots.items()}
        return replace(self, placed=placed, roots=roots, joints=joints)

    def opened(self, values: Mapping[tuple[str, str], float]) -> dict[str, PosedBody]:
        """Returns all bodies with some joints open: (piece, joint) -> [m or rad]."""
        placed = dict(self.placed)
        for joint in sorted(self.joints, key=lambda j: -j.rank):
            value = values.get((joint.piece, joint.name), 0.0)
            if value:
                motion = joint.motion(value)
                placed |= {body.name: placed[body.name].moved(motion) for body in joint.members}
        return placed


def depth_m(first: PosedBody, second: PosedBody) -> float:
    """Returns the penetration depth [m] of two bodies: the maximum over pairs of convex shapes."""
    near = (first.low_m[:, None] < second.high_m) & (second.low_m < first.high_m[:, None])
    deepest = 0.0
    for i, j in np.argwhere(near.all(axis=2)):
        result = coal.CollisionResult()
        if coal.collide(
            first.shapes.geometries[i],
            first.world_from_shape[i],
            second.shapes.geometries[j],
            second.world_from_shape[j],
            _REQUEST,
            result,
        ):
            deepest = max(deepest, -result.getContact(0).penetration_depth)
    return deepest


def overlaps(movers: Bodies, others: Bodies) -> Iterator[tuple[PosedBody, PosedBody, float]]:
    """Yields pairs of a mover and an overlapping body of another piece, with the depth [m]."""
    for body in movers.all:
        for other in others.near(body.box_m):
            depth = depth_m(body, other) if other.piece != body.piece else 0.0
            if depth > 0:
                yield body, other, depth


@dataclass(frozen=True, kw_only=True, eq=False)
class _Furniture:
    """An articulated template with its root at the origin; links have their bare names."""

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
def _furniture(urdf_file: Path, scale: float) -> _Furniture:
    instance = ArticulationInstance(
        name="furniture",
        template="furniture",
        urdf_file=urdf_file,
        world_from_root=IDENTITY,
        scale=scale,
    )
    built = BodyBuilder(bare_scene()).articulation(instance, 1)
    engine: Any = sapien_object(built)
    engine.set_qpos(np.zeros(engine.dof, dtype=np.float32))  # updates the links' poses
    links = [(link.name, sapien_object(link)) for link in built.links]
    placed: dict[Any, PosedBody] = {}
    for name, link in links:
        shapes = _rigid(read_body(name, "furniture", link).shapes)
        placed[link] = pose_body(name, "", shapes, matrix(link.entity_pose))
    joints = [_joint(j.name, sapien_object(j).child_link, placed) for j in built.active_joints]
    return _Furniture(links=tuple(placed.values()), joints=tuple(joints))


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


def _rigid(shapes: Iterable[CollisionShape]) -> RigidShapes:
    shapes = tuple(shapes)
    corners = [body_points(shape) for shape in shapes]
    made = [coal_shape(shape) for shape in shapes]
    poses = [shape.body_from_shape @ pose for shape, (_, pose) in zip(shapes, made, strict=True)]
    counts = [points.shape[1] for points in corners]
    return RigidShapes(
        geometries=tuple(geometry for geometry, _ in made),
        body_from_shape=np.array(poses).reshape(-1, 4, 4),
        points=np.concatenate(corners, axis=1) if corners else np.zeros((4, 0)),
        starts=np.cumsum([0, *counts[:-1]]) if counts else np.zeros(0, dtype=np.int64),
    )
