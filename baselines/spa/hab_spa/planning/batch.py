"""Arrays of a collision model for the compiled kernel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from hab_spa.shapes import Array, shape_bounds_m
from hab_tasks.privileged import CollisionBody, CollisionShape
from hab_tasks.robots.kinematics import arm_model
from hab_tasks.robots.spec import RobotSpec
from hab_tasks.world.raycast.compiled import load

HIT, FREE, UNSURE = 0, 1, 2
HULL, BOX, OUTER, VOXELS = 0, 1, 2, 3
"""Kinds of shapes: vertices, bounding box, a bounding box that contains the actual shape, and cubes
of one size with `vertices_m` as centres."""

BLOCK = 16
"""Voxels that are sorted out together."""

NO_PAIR = -1e9
"""Margin of pairs that are not checked."""

ROUNDING_M = 4e-6
"""More than single precision takes off a distance within 10 m of the arm."""

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Ints = NDArray[np.int64]
Point = tuple[float, float, float]


class Shapes(NamedTuple):
    """Shapes of a collision model: S static ones, then M moving ones; N = S + M.

    The last static ones are the rest of the robot, which goes with the arm's root. In `place`,
    `local_m` and `span`, one row more is scratch: a single voxel, as a box.

    Attributes:
        chain: (J, 13) the joints: placement (rotation by rows, translation) and axis: 0, 1 or 2 of
            rotation, 3, 4 or 5 of sliding.
        root: (1, 12) pose of the arm's root, in the frame where it stood at first.
        box_m: (6, S) bounding boxes of the scene's shapes in that frame, rounded outwards; of the
            robot's, scratch.
        place: (N + 1, 12) poses of the scene's shapes in that frame, of the others in that of
            their joint, or of the root.
        local_m: (N + 1, 9) bounding box in the shape's frame, radius around vertices, half
            diagonal, radius of the sphere within, around the box's centre or each vertex.
        span: (N + 1, 5) int64: first vertex, the one after the last, kind, joint (of the scene's,
            -1), first block.
        vertices_m: (3, V) in the shapes' frames.
        block_m: (4, K) centres and radii of spheres around `BLOCK` successive voxels each.
        group_m: (G, 4) bounding spheres of the moving bodies, in their joint's frame.
        member: (G, 3) int64: joint, first moving shape, the one after the last.
        own: (P, 2) int64 pairs of moving shapes, counted in N.
        margin_m: (M, N) margins of pairs; `NO_PAIR` where there is none.
    """

    chain: NDArray[np.float64]
    root: NDArray[np.float64]
    box_m: NDArray[np.float32]
    place: NDArray[np.float64]
    local_m: NDArray[np.float64]
    span: NDArray[np.int64]
    vertices_m: NDArray[np.float64]
    block_m: NDArray[np.float64]
    group_m: NDArray[np.float64]
    member: NDArray[np.int64]
    own: NDArray[np.int64]
    margin_m: NDArray[np.float64]


EMPTY = Shapes(
    chain=np.zeros((0, 13)),
    root=np.zeros((1, 12)),
    box_m=np.zeros((6, 0), dtype=np.float32),
    place=np.zeros((1, 12)),
    local_m=np.zeros((1, 9)),
    span=np.zeros((1, 5), dtype=np.int64),
    vertices_m=np.zeros((3, 0)),
    block_m=np.zeros((4, 0)),
    group_m=np.zeros((0, 4)),
    member=np.zeros((0, 3), dtype=np.int64),
    own=np.zeros((0, 2), dtype=np.int64),
    margin_m=np.zeros((0, 0)),
)


class Scratch(NamedTuple):
    """Arrays that the kernel writes.

    Attributes:
        joints: (J + 2, 12) poses of the root and the joints, and scratch.
        box_m: As in `Shapes`.
        placed: (N + 1, 12) poses of the shapes.
        w, weight: (4, 3) a simplex and the weights (4,) of its corners.
        near: (S,) whether a static shape is near; padded to a multiple of eight.
        eight: The same memory, eight shapes at a time.
        centre_m: (M, 3) centres of moving shapes.
        is_placed: (M,) whether the pose of each moving shape is up to date.
        todo: (P, 2) pairs that are near.
        pose: (1, J) an arm pose.
        reach_m: (1,) the largest margin.
    """

    joints: Floats
    box_m: Singles
    placed: Floats
    w: Floats
    weight: Floats
    near: NDArray[np.uint8]
    eight: NDArray[np.uint64]
    centre_m: Floats
    is_placed: NDArray[np.bool_]
    todo: Ints
    pose: Floats
    reach_m: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class Outlines:
    """Shapes of a body, or several, in each shape's frame.

    Attributes:
        body_from_shape: (S, 4, 4) poses.
        local_m: (S, 9) bounding box of the vertices, radius around them, half diagonal of the box,
            radius of a sphere around its centre within the vertices, or -1; of voxels, half edge.
        kind: (S,) kinds of shapes.
        vertices_m: Vertices (V, 3) of each, centres of voxels; empty for boxes.
    """

    body_from_shape: Array
    local_m: Array
    kind: NDArray[np.int64]
    vertices_m: list[Array]


# Weak, so that the outlines go with the bodies of a scene that was rebuilt.
_outlines: WeakKeyDictionary[CollisionBody, Outlines] = WeakKeyDictionary()


def outlines(body: CollisionBody) -> Outlines:
    """Returns the shapes of a body; computed once, shared by all scenes that contain it.

    Raises:
        ValueError: A shape is not finite.
    """
    if body not in _outlines:
        local_m = np.array([_local_m(shape) for shape in body.shapes]).reshape(-1, 9)
        poses = np.array([shape.body_from_shape for shape in body.shapes]).reshape(-1, 4, 4)
        if not (np.isfinite(local_m).all() and np.isfinite(poses).all()):
            raise ValueError(f"{body.name}: a collision shape is not finite; rebuild the scene.")
        kinds = {"convex": HULL, "cylinder": OUTER}
        _outlines[body] = Outlines(
            body_from_shape=poses,
            local_m=local_m,
            kind=np.array([kinds.get(shape.kind, BOX) for shape in body.shapes], dtype=np.int64),
            vertices_m=[shape.vertices_m for shape in body.shapes],
        )
    return _outlines[body]


def _local_m(shape: CollisionShape) -> Array:
    """Returns a shape's bounding box and radii (9,); a capsule is a segment with a radius."""
    radius = 0.0
    lower, upper = shape_bounds_m(shape)
    if shape.kind in ("sphere", "capsule"):
        radius = float(shape.half_size_m[0])
        lower, upper = lower + radius, upper - radius
    inner = -1.0
    if shape.kind == "convex":
        a, b, c = shape.vertices_m[shape.faces].transpose(1, 0, 2)
        normals = np.cross(b - a, c - a)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        # Of either orientation: the centre is outside if it is beyond a face.
        inside = ((shape.vertices_m.mean(axis=0) - a) * normals).sum(axis=1)
        depth = ((lower + upper) / 2 - a) * normals * np.sign(inside)[:, None]
        inner = max(-1.0, float(depth.sum(axis=1).min()))
    # What is inside the box of a cylinder may be outside of the cylinder.
    elif shape.kind != "cylinder":
        inner = float((upper - lower).min() / 2)
    return np.array((*lower, *upper, radius, np.linalg.norm(upper - lower) / 2, inner))


def corners_m(local_m: Array, frame_from_shape: Array) -> Array:
    """Returns the corners (S, 8, 3) of bounding boxes (S, 9) with their radius, in a frame."""
    radius_m = local_m[:, 6:7]
    bounds = np.stack((local_m[:, :3] - radius_m, local_m[:, 3:6] + radius_m))  # (2, S, 3)
    which = np.array(np.meshgrid(*[(0, 1)] * 3)).reshape(3, 8).T
    corners = bounds[which[:, :, None], np.arange(len(local_m)), np.arange(3)[:, None]]
    corners = corners.transpose(2, 0, 1)  # (S, 8, 3)
    turned = corners @ frame_from_shape[:, :3, :3].transpose(0, 2, 1)
    return turned + frame_from_shape[:, None, :3, 3]


def rows_of(poses: Array) -> Array:
    """Returns poses (S, 4, 4) as rows (S, 12): rotation by rows, translation."""
    return np.concatenate((poses[:, :3, :3].reshape(-1, 9), poses[:, :3, 3]), axis=1)


def boxes_of(local_m: Array, root_from_shape: Array) -> NDArray[np.float32]:
    """Returns the bounding boxes (6, S) in the root frame, rounded outwards."""
    turn = root_from_shape[:, :3, :3]
    middle = (0.5 * (local_m[:, None, :3] + local_m[:, None, 3:6]) * turn).sum(axis=2)
    half = (0.5 * (local_m[:, None, 3:6] - local_m[:, None, :3]) * np.abs(turn)).sum(axis=2)
    middle, half = middle + root_from_shape[:, :3, 3], half + local_m[:, 6:7] + ROUNDING_M
    return np.concatenate((middle - half, middle + half), axis=1).T.astype(np.float32, order="C")


def groups_of(bodies: Sequence[str], joint: NDArray[np.int64], local_m: Array, place: Array) -> Any:
    """Returns the bounding spheres (G, 4) of moving bodies and their members (G, 3).

    Args:
        bodies: Body of each moving shape, in order.
        joint: (M,) joint of each.
        local_m: (M, 9) as in `Outlines`.
        place: (M, 4, 4) poses in their joints' frames.
    """
    corners = corners_m(local_m, place)
    starts = [i for i in range(len(bodies)) if i == 0 or bodies[i] != bodies[i - 1]]
    spheres, members = [], []
    # Shapes of a body move together, so that one sphere sorts out all of them.
    for first, last in zip(starts, [*starts[1:], len(bodies)], strict=True):
        points = corners[first:last].reshape(-1, 3)
        centre = (points.min(axis=0) + points.max(axis=0)) / 2
        spheres.append((*centre, np.linalg.norm(points - centre, axis=1).max()))
        members.append((joint[first], first, last))
    return np.array(spheres).reshape(-1, 4), np.array(members, dtype=np.int64).reshape(-1, 3)


def packed(vertices_m: Sequence[Array]) -> tuple[Array, NDArray[np.int64]]:
    """Returns vertices (3, V) of all shapes, and the first and the one after the last of each."""
    ends = np.cumsum([0, *(len(vertices) for vertices in vertices_m)])
    # By coordinate, which lets the kernel run over vertices with vector instructions.
    joined = np.concatenate((np.zeros((0, 3)), *vertices_m)).T
    return np.ascontiguousarray(joined), np.stack((ends[:-1], ends[1:]), axis=1)


def blocks_of(
    vertices_m: Sequence[Array], kinds: NDArray[np.int64], half_m: Array
) -> tuple[Array, NDArray[np.int64]]:
    """Returns spheres (4, K) around blocks of voxels, and the first of each shape (S,).

    Args:
        vertices_m: Vertices (V, 3) of each shape, or centres of its voxels.
        kinds: (S,) kinds of shapes.
        half_m: (S,) half the edge of each shape's voxels.
    """
    spheres, first, count = [np.zeros((0, 4))], [], 0
    for centres_m, kind, half in zip(vertices_m, kinds, half_m, strict=True):
        first.append(count)
        if kind != VOXELS:
            continue
        starts = np.arange(0, len(centres_m), BLOCK)
        lower = np.minimum.reduceat(centres_m, starts) - half
        upper = np.maximum.reduceat(centres_m, starts) + half
        radius = np.linalg.norm(upper - lower, axis=1, keepdims=True) / 2
        spheres.append(np.hstack(((lower + upper) / 2, radius)))
        count += len(starts)
    return np.ascontiguousarray(np.concatenate(spheres).T), np.array(first, dtype=np.int64)


JOINTS = tuple(f"JointModel{kind}{axis}" for kind in "RP" for axis in "XYZ")
"""Pinocchio's names of joints that rotate about, or slide along, an axis of their own frame."""


@cache
def chain_of(robot: RobotSpec) -> Array:
    """Returns the joints (J, 13) of the arm: placements and axes; made once, do not modify.

    Raises:
        ValueError: A joint has another axis than x, y or z.
    """
    rows, (model, _) = [], arm_model(robot)
    joints = zip(model.names, model.joints, model.jointPlacements, strict=True)
    for name, joint, placement in list(joints)[1:]:  # Pinocchio's first joint is the world
        if joint.shortname() not in JOINTS:
            raise ValueError(f"{robot.uid}: planners need x, y or z as the axis of joint {name}.")
        axis = JOINTS.index(joint.shortname())
        rows.append((*placement.rotation.ravel(), *placement.translation, axis))
    return np.array(rows)


@lru_cache(maxsize=1)
def kernel() -> Any:
    """Returns the module `hab_spa.planning.kernel`, compiled."""
    return load("hab_spa.planning.kernel", _compile)


def _compile(module: Any) -> None:
    """Checks no poses in an empty model, which compiles the kernel or reads it from the cache."""
    pairs, answers = np.zeros((0, 2), dtype=np.int64), np.zeros(0, dtype=np.uint8)
    module.undecided(EMPTY, np.zeros((1, 0)), pairs, answers)
    module.check(EMPTY, np.zeros((0, 0)), EMPTY.root, True, answers)


@lru_cache(maxsize=1)
def ik_kernel() -> Any:
    """Returns the module `hab_spa.planning.ik_kernel`, compiled."""
    return load("hab_spa.planning.ik_kernel", _compile_ik)


def _compile_ik(module: Any) -> None:
    """Moves no poses."""
    chain, limits, none = EMPTY.chain, np.zeros((2, 0)), np.zeros((0, 3))
    poses, numbers = np.zeros((0, 0)), np.zeros(0)
    module.solve(chain, limits, np.zeros(9), poses, none, np.zeros(4), numbers)
    module.track(chain, limits, np.zeros(3), poses, np.zeros((0, 12)), numbers, 3)
    module.positions(chain, np.zeros(3), poses, none)


@lru_cache(maxsize=1)
def search_kernel() -> Any:
    """Returns the module `hab_spa.planning.search_kernel`, compiled."""
    return load("hab_spa.planning.search_kernel", _compile_search)


def _compile_search(module: Any) -> None:
    """Searches in an empty model, from and to nowhere."""
    trees, parents = np.zeros((2, 0, 0)), np.zeros((2, 0), dtype=np.int64)
    none, checks = np.zeros((0, 3)), np.zeros(1, dtype=np.int64)
    module.connect(EMPTY, trees, parents, none, 1.0, 1.0, 0, checks)
    module.first_free(EMPTY, np.zeros((1, 0)), np.zeros((0, 0)), 1.0, checks)
    module.shorten(EMPTY, np.zeros((0, 0)), 0, none, 1, 1.0, 1.0, checks)
