"""The fridge by its known shape: boxes, points to look for, and its bodies at a pose (S App. D).

Both scene datasets have this fridge, the apartment also with its hinges on the other side. Poses
(4,) are x, y [m] and yaw [rad] of the middle of the closed front, facing out, and the upper door's
opening [rad]. `side` is 1 if the handle is on the left as seen from inside, and -1 on the right.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from hab_spa.shapes import Array
from hab_tasks.privileged import ArticulationState, CollisionBody, CollisionShape

Boxes = tuple[tuple[tuple[float, float, float], tuple[float, float, float]], ...]
"""Middles and sizes [m] in the hinge's frame: out of the front, from the hinge to the handle, up
from the floor."""

BODY: Boxes = (
    ((-0.322, 0.023, 1.0175), (0.633, 0.03, 1.835)),
    ((-0.322, 0.683, 1.0175), (0.633, 0.03, 1.835)),
    ((-0.322, 0.353, 1.95), (0.633, 0.69, 0.03)),
    ((-0.312, 0.353, 0.86), (0.593, 0.63, 0.03)),
    ((-0.338, 0.353, 1.61), (0.5415, 0.63, 0.02)),
    ((-0.338, 0.353, 1.24), (0.5415, 0.63, 0.02)),
    ((-0.338, 0.353, 1.047), (0.5415, 0.63, 0.02)),
    ((-0.6235, 0.353, 1.0175), (0.03, 0.63, 1.835)),
)
LOWER_DOOR: Boxes = (((0.035, 0.346, 0.459), (0.053, 0.69, 0.77)),)
UPPER_DOOR: Boxes = (((0.035, 0.346, 1.415), (0.053, 0.69, 1.103)),)
HANDLES: Boxes = (
    ((0.1, 0.62, 0.609), (0.014, 0.014, 0.4)),
    ((0.1, 0.62, 1.195), (0.014, 0.014, 0.52)),
)
"""The lower door's, which is fixed here, and the upper door's."""

FRONT_M, WIDTH_M = 0.0615, 0.691
"""Distance of the closed front from the hinge, and its width."""

SHELVES_M = (1.0, 1.94)
"""Heights between which things stand behind the upper door."""

STRIP_M = 0.11
"""Width of the strips along the front's edges in which handles are."""

MOST_RAD = 2.3

DOOR_NAME, BODY_NAME = "seen_fridge/door", "seen_fridge/body"


@dataclass(frozen=True, kw_only=True, eq=False)
class Outline:
    """Points on the fridge's faces in the hinge's frame, for `hab_spa.sensing.fit_kernel`.

    Attributes:
        points_m: (P, 3).
        normals: (P, 3).
        kind: (P,) bits: 1 moves with the upper door, 2 is on a front, which nothing may hide, 4 may
            have a handle before it.
    """

    points_m: Array
    normals: Array
    kind: NDArray[np.int64]


@cache
def outline(spacing_m: float, side: int, with_door: bool = True) -> Outline:
    """Returns points at a spacing; without those that move, on demand."""
    parts = ((BODY, 0), (LOWER_DOOR, 2), *(((UPPER_DOOR, 3),) if with_door else ()))
    points, normals, kinds = [], [], []
    for boxes, kind in parts:
        for middle, size in boxes:
            found_m, outward = _faces(np.array(middle), np.array(size), spacing_m)
            front = outward[:, 0] > 0.5
            near_edge = np.abs(found_m[:, 1] - WIDTH_M / 2) > WIDTH_M / 2 - STRIP_M
            bits = np.full(len(found_m), kind & 1)
            bits[front] |= kind & 2
            bits[front & near_edge & (kind > 0)] |= 4
            points.append(found_m)
            normals.append(outward)
            kinds.append(bits)
    mirror = np.array((1.0, side, 1.0))
    return Outline(
        points_m=np.concatenate(points) * mirror,
        normals=np.concatenate(normals) * mirror,
        kind=np.concatenate(kinds).astype(np.int64),
    )


def _faces(middle_m: Array, size_m: Array, spacing_m: float) -> tuple[Array, Array]:
    """Returns points (P, 3) on the faces of a box, with their normals (P, 3)."""
    points, normals = [], []
    counts = np.maximum(1, np.round(size_m / spacing_m).astype(int))
    steps = [((np.arange(count) + 0.5) / count - 0.5) for count in counts]
    for axis in range(3):
        for sign in (-1.0, 1.0):
            ticks = [np.array([0.5 * sign]) if a == axis else steps[a] for a in range(3)]
            grid = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 3)
            points.append(middle_m + grid * size_m)
            normals.append(np.tile(sign * np.eye(3)[axis], (len(grid), 1)))
    return np.concatenate(points), np.concatenate(normals)


def hinges_of(poses: Array, side: int) -> Array:
    """Returns poses (K, 4) with the hinge as the origin instead of the front's middle."""
    found, cosine, sine = poses.copy(), np.cos(poses[:, 2]), np.sin(poses[:, 2])
    aside = side * WIDTH_M / 2
    found[:, 0] -= cosine * FRONT_M - sine * aside
    found[:, 1] -= sine * FRONT_M + cosine * aside
    return found


def articulation_of(pose: Array, side: int, held: bool) -> ArticulationState:
    """Returns the state of the upper door at a pose (4,)."""
    x, y, yaw, joint = hinges_of(pose[None], side)[0].tolist()
    out = np.array((np.cos(yaw), np.sin(yaw), 0.0))
    along = side * np.array((-np.sin(yaw), np.cos(yaw), 0.0))
    hinge_m = np.array((x, y, 0.0))
    (_, _, height_m), _ = HANDLES[1]
    handle_m = hinge_m + 0.1 * out + 0.62 * along + np.array((0.0, 0.0, height_m))
    centre_m = hinge_m - 0.322 * out + 0.353 * along
    closed = ArticulationState(
        kind="fridge",
        body=DOOR_NAME,
        handle_m=handle_m,
        held=held,
        joint=0.0,
        limits=(0.0, MOST_RAD),
        slides=False,
        axis=np.array((0.0, 0.0, -float(side))),
        axis_point_m=hinge_m,
        frame=np.array((*centre_m[:2], yaw)),
    )
    moved = closed.moved(joint)
    return ArticulationState(
        **{
            **vars(closed),
            "joint": joint,
            "handle_m": (moved @ np.append(handle_m, 1.0))[:3],
        }
    )


@cache
def bodies(side: int) -> tuple[CollisionBody, CollisionBody]:
    """Returns the fridge and its upper door, in the hinge's frame."""
    fixed, moving = (*BODY, *LOWER_DOOR, HANDLES[0]), (*UPPER_DOOR, HANDLES[1])
    return box_body(BODY_NAME, fixed, side), box_body(DOOR_NAME, moving, side)


def box_body(name: str, boxes: Boxes, side: int = 1) -> CollisionBody:
    """Returns a body of boxes."""
    shapes = tuple(_box(box, side) for box in boxes)
    return CollisionBody(name=name, group="furniture", shapes=shapes)


def _box(box: tuple[tuple[float, ...], tuple[float, ...]], side: int) -> CollisionShape:
    pose = np.eye(4)
    pose[:3, 3] = np.array(box[0]) * (1.0, side, 1.0)
    return CollisionShape(
        kind="box",
        body_from_shape=pose,
        half_size_m=np.array(box[1]) / 2,
        vertices_m=np.zeros((0, 3)),
        faces=np.zeros((0, 3), dtype=np.int64),
    )


def poses_of(pose: Array, side: int) -> dict[str, Array]:
    """Returns the poses (4, 4) of the bodies, by name."""
    x, y, yaw, joint = hinges_of(pose[None], side)[0].tolist()
    fixed = np.eye(4)
    fixed[:2, :2] = ((np.cos(yaw), -np.sin(yaw)), (np.sin(yaw), np.cos(yaw)))
    fixed[:2, 3] = x, y
    turn, angle = np.eye(4), -side * joint
    turn[:2, :2] = ((np.cos(angle), -np.sin(angle)), (np.sin(angle), np.cos(angle)))
    return {BODY_NAME: fixed, DOOR_NAME: fixed @ turn}
