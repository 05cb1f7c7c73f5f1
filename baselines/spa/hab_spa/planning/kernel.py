"""Collision checks of arm poses in batches, compiled by numba.

A check sorts out shapes that are far apart by bounding boxes and spheres; GJK (Gilbert, Johnson,
Keerthi 1988) bounds the distance of the others from both sides. Free and colliding are said only
where a bound clears the margin by some slack; else the answer is `UNSURE`, and coal decides
(`hab_spa.planning.collision`).
"""

from __future__ import annotations

from math import cos, sin, sqrt

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hab_spa.planning.batch import (
    BLOCK,
    BOX,
    FREE,
    HIT,
    NO_PAIR,
    ROUNDING_M,
    VOXELS,
    Floats,
    Ints,
    Point,
    Scratch,
    Shapes,
    Singles,
)
from hab_spa.planning.gjk import (
    CLOSER_M,
    SLACK_M,
    called,
    dot,
    fast,
    gjk,
    inlined,
    out_of,
    to,
    turned,
)

compiled = njit(cache=True, nogil=True, error_model="numpy")

NONE = np.float32(0.0)


@inlined
def _joined(first: Floats, i: int, second: Floats, j: int, out: Floats, k: int) -> None:
    """Writes the pose `first[i]` after `second[j]` to `out[k]`, rows of 12."""
    for row in range(3):
        a, b, c = first[i, 3 * row], first[i, 3 * row + 1], first[i, 3 * row + 2]
        for column in range(3):
            out[k, 3 * row + column] = (
                a * second[j, column] + b * second[j, 3 + column] + c * second[j, 6 + column]
            )
        out[k, 9 + row] = (
            a * second[j, 9] + b * second[j, 10] + c * second[j, 11] + first[i, 9 + row]
        )


@inlined
def kinematics(chain: Floats, poses: Floats, b: int, joints: Floats) -> None:
    """Writes the poses of root and joints; the last row of `joints` is scratch."""
    spare = len(chain) + 1
    for j in range(len(chain)):
        _joined(joints, j, chain, j, joints, spare)
        axis, slides = int(chain[j, 12]) % 3, chain[j, 12] > 2.0
        u, v = (axis + 1) % 3, (axis + 2) % 3
        c, s = (1.0, 0.0) if slides else (cos(poses[b, j]), sin(poses[b, j]))
        for row in range(3):
            across, along = joints[spare, 3 * row + u], joints[spare, 3 * row + v]
            joints[j + 1, 3 * row + axis] = joints[spare, 3 * row + axis]
            joints[j + 1, 3 * row + u] = c * across + s * along
            joints[j + 1, 3 * row + v] = c * along - s * across
            joints[j + 1, 9 + row] = joints[spare, 9 + row]
            if slides:
                joints[j + 1, 9 + row] += poses[b, j] * joints[spare, 3 * row + axis]


@inlined
def _centre(local_m: Floats, i: int, placed: Floats) -> Point:
    """Returns the centre of a shape's bounding box."""
    return out_of(
        placed,
        i,
        0.5 * (local_m[i, 0] + local_m[i, 3]),
        0.5 * (local_m[i, 1] + local_m[i, 4]),
        0.5 * (local_m[i, 2] + local_m[i, 5]),
    )


@inlined
def _from_box(local_m: Floats, i: int, placed: Floats, centre: Point) -> Point:
    """Returns the vector to a point from a shape's bounding box, in the shape's frame."""
    x, y, z = turned(
        placed, i, centre[0] - placed[i, 9], centre[1] - placed[i, 10], centre[2] - placed[i, 11]
    )
    return (
        x - min(max(x, local_m[i, 0]), local_m[i, 3]),
        y - min(max(y, local_m[i, 1]), local_m[i, 4]),
        z - min(max(z, local_m[i, 2]), local_m[i, 5]),
    )


@inlined
def _gap2(local_m: Floats, i: int, placed: Floats, centre: Point) -> float:
    """Returns the squared distance of a point from a shape's bounding box."""
    away = _from_box(local_m, i, placed, centre)
    return dot(away, away)


@inlined
def _extent(local_m: Floats, i: int, v: Point) -> float:
    """Returns how far a shape's bounding box reaches from its centre along a vector, times that."""
    return 0.5 * (
        (local_m[i, 3] - local_m[i, 0]) * abs(v[0])
        + (local_m[i, 4] - local_m[i, 1]) * abs(v[1])
        + (local_m[i, 5] - local_m[i, 2]) * abs(v[2])
    )


@called
def _voxels(shapes: Shapes, work: Scratch, moving: int, other: int, margin_m: float) -> int:
    """Decides the pair of a moving shape and voxels, one after the other."""
    local_m, placed, one = shapes.local_m, work.placed, len(shapes.local_m) - 1
    half_m, radius_m, found = local_m[other, 8], local_m[moving, 6], FREE
    over_m = max(margin_m, 0.0) + SLACK_M + radius_m
    # Spheres within the moving shape and within a voxel: they overlap only if the shapes do.
    inner_m = local_m[moving, 8] + half_m + radius_m + margin_m - CLOSER_M
    certain = margin_m >= 0.0 and inner_m > 0.0
    here, reach_m = _centre(local_m, moving, placed), over_m + half_m * sqrt(3.0)
    for k in range(12):
        placed[one, k] = placed[other, k]
    first, last = shapes.span[other, 0], shapes.span[other, 1]
    # Rounded up, as the last block may be short.
    for block in range(-((first - last) // BLOCK)):
        k = shapes.span[other, 4] + block
        x, y, z = shapes.block_m[0, k], shapes.block_m[1, k], shapes.block_m[2, k]
        far_m = over_m + shapes.block_m[3, k]
        if _gap2(local_m, moving, placed, out_of(placed, other, x, y, z)) > far_m * far_m:
            continue
        for i in range(first + block * BLOCK, min(last, first + (block + 1) * BLOCK)):
            x, y, z = shapes.vertices_m[0, i], shapes.vertices_m[1, i], shapes.vertices_m[2, i]
            there = out_of(placed, other, x, y, z)
            if _gap2(local_m, moving, placed, there) > reach_m * reach_m:
                continue
            v = to(there, here)
            if certain and dot(v, v) < inner_m * inner_m:
                return HIT
            for axis in range(3):
                middle_m = shapes.vertices_m[axis, i]
                local_m[one, axis], local_m[one, axis + 3] = middle_m - half_m, middle_m + half_m
            if dot(v, v) < 1e-12:
                v = (1.0, 0.0, 0.0)
            said = gjk(shapes, placed, moving, one, margin_m, v, work.w, work.weight)
            if said == HIT:
                return HIT
            found = max(found, said)
    return found


@inlined
def _pair(shapes: Shapes, work: Scratch, moving: int, other: int, margin_m: float) -> int:
    """Decides one pair: by spheres against boxes, then by GJK."""
    local_m, placed = shapes.local_m, work.placed
    radius_m = local_m[moving, 6] + local_m[other, 6]
    over_m = max(margin_m, 0.0) + SLACK_M + radius_m
    here = _centre(local_m, moving, placed)
    away, reach_m = _from_box(local_m, other, placed, here), over_m + local_m[moving, 7]
    gap2 = dot(away, away)
    if gap2 > reach_m * reach_m:
        return FREE
    # From the box to the centre: a plane across it parts the box from most shapes.
    x, y, z = out_of(placed, other, away[0], away[1], away[2])
    v = (x - placed[other, 9], y - placed[other, 10], z - placed[other, 11])
    beyond = gap2 - _extent(local_m, moving, turned(placed, moving, v[0], v[1], v[2]))
    if beyond > 0.0 and beyond * beyond > gap2 * over_m * over_m:
        return FREE
    # A sphere inside the moving shape, from its centre.
    inner_m = local_m[moving, 8] + radius_m + margin_m - CLOSER_M
    certain = margin_m >= 0.0 and inner_m > 0.0
    if certain and shapes.span[other, 2] == BOX and gap2 < inner_m * inner_m:
        return HIT
    there = _centre(local_m, other, placed)
    reach_m = over_m + local_m[other, 7]
    if _gap2(local_m, moving, placed, there) > reach_m * reach_m:
        return FREE
    if shapes.span[other, 2] == VOXELS:
        return _voxels(shapes, work, moving, other, margin_m)
    apart = to(there, here)
    # -1 m where no sphere is known within the other shape, which makes the sum negative.
    inner_m += max(local_m[other, 8], -1.0)
    if margin_m >= 0.0 and inner_m > 0.0 and dot(apart, apart) < inner_m * inner_m:
        return HIT
    if gap2 < 1e-12:
        # GJK starts from any direction, and equal centres give none.
        v = apart if dot(apart, apart) >= 1e-12 else (1.0, 0.0, 0.0)
    return gjk(shapes, placed, moving, other, margin_m, v, work.w, work.weight)


@fast
def _near(
    box_m: Singles, x: np.float32, y: np.float32, z: np.float32, reach2: np.float32,
    near: NDArray[np.uint8],
) -> None:  # fmt: skip
    """Writes whether each box (6, S) is within reach of a point."""
    for s in range(box_m.shape[1]):
        dx = max(box_m[0, s] - x, x - box_m[3, s], NONE)
        dy = max(box_m[1, s] - y, y - box_m[4, s], NONE)
        dz = max(box_m[2, s] - z, z - box_m[5, s], NONE)
        near[s] = dx * dx + dy * dy + dz * dz < reach2


@inlined
def _with_scene(shapes: Shapes, work: Scratch, g: int) -> int:
    """Writes the pairs (P, 2) of a group with static shapes within reach; returns P."""
    statics, margin_m, group_m, count = shapes.box_m.shape[1], shapes.margin_m, shapes.group_m, 0
    near, todo, first, last = work.near, work.todo, shapes.member[g, 1], shapes.member[g, 2]
    x, y, z = group_m[g, 0], group_m[g, 1], group_m[g, 2]
    x, y, z = out_of(work.joints, shapes.member[g, 0], x, y, z)
    reach_m = group_m[g, 3] + work.reach_m[0]
    single = np.float32
    _near(work.box_m, single(x), single(y), single(z), single(reach_m * reach_m), near)
    # Few are near: eight at a time are skipped.
    for word in range(len(work.eight)):
        if work.eight[word] == 0:
            continue
        for s in range(8 * word, min(8 * word + 8, statics)):
            if not near[s]:
                continue
            for m in range(first, last):
                if margin_m[m, s] != NO_PAIR:
                    todo[count, 0], todo[count, 1] = statics + m, s
                    count += 1
    return count


@inlined
def _within(shapes: Shapes, work: Scratch) -> int:
    """Writes the pairs (P, 2) of moving shapes within reach; returns P."""
    own, local_m, todo, count = shapes.own, shapes.local_m, work.todo, 0
    statics, centre_m = shapes.box_m.shape[1], work.centre_m
    for m in range(len(centre_m)):
        i = statics + m
        x, y, z = _centre(local_m, i, shapes.place)
        x, y, z = out_of(work.joints, shapes.span[i, 3], x, y, z)
        centre_m[m, 0], centre_m[m, 1], centre_m[m, 2] = x, y, z
    for p in range(len(own)):
        i, j, gap2 = own[p, 0], own[p, 1], 0.0
        for axis in range(3):
            gap2 += (centre_m[i - statics, axis] - centre_m[j - statics, axis]) ** 2
        reach_m = local_m[i, 6] + local_m[i, 7] + local_m[j, 6] + local_m[j, 7] + work.reach_m[0]
        if gap2 < reach_m * reach_m:
            todo[count, 0], todo[count, 1] = i, j
            count += 1
    return count


@inlined
def answer(shapes: Shapes, poses: Floats, b: int, work: Scratch) -> int:
    """Checks an arm pose of (B, J): `HIT`, `FREE` or `UNSURE`."""
    statics, found = shapes.box_m.shape[1], FREE
    _move(shapes, poses, b, work)
    # The hand, which collides most, first; the arm with itself last.
    for g in range(len(shapes.member) - 1, -2, -1):
        count = _with_scene(shapes, work, g) if g >= 0 else _within(shapes, work)
        for p in range(count):
            i, j = work.todo[p, 0], work.todo[p, 1]
            _place(shapes, work, i)
            _place(shapes, work, j)
            said = _pair(shapes, work, i, j, float(shapes.margin_m[i - statics, j]))
            if said == HIT:
                return HIT
            # `UNSURE` is the larger: a pair in doubt leaves the pose in doubt, unless another one
            # hits.
            found = max(found, said)
    return found


@inlined
def _move(shapes: Shapes, poses: Floats, b: int, work: Scratch) -> None:
    """Writes the poses of joints at an arm pose; shapes are placed when a pair needs them."""
    kinematics(shapes.chain, poses, b, work.joints)
    for m in range(len(work.centre_m)):
        work.is_placed[m] = False


@inlined
def _place(shapes: Shapes, work: Scratch, i: int) -> None:
    """Writes the pose of a shape, unless it is static or placed already."""
    m = i - shapes.box_m.shape[1]
    if m >= 0 and not work.is_placed[m]:
        _joined(work.joints, shapes.span[i, 3], shapes.place, i, work.placed, i)
        work.is_placed[m] = True


@inlined
def _stand(shapes: Shapes, work: Scratch, roots: Floats, b: int) -> None:
    """Sets the arm's root, and the robot's shapes that go with it, to a pose of (B, 12)."""
    local_m, placed = shapes.local_m, work.placed
    for k in range(12):
        work.joints[0, k] = roots[b, k]
    for s in range(shapes.box_m.shape[1] - 1, -1, -1):
        if shapes.span[s, 3] < 0:
            break
        _joined(roots, b, shapes.place, s, placed, s)
        middle_m = _centre(local_m, s, placed)
        for axis in range(3):
            half_m = local_m[s, 6] + ROUNDING_M
            for k in range(3):
                extent_m = local_m[s, 3 + k] - local_m[s, k]
                half_m += 0.5 * extent_m * abs(placed[s, 3 * axis + k])
            work.box_m[axis, s] = middle_m[axis] - half_m
            work.box_m[3 + axis, s] = middle_m[axis] + half_m


@njit(nogil=True, error_model="numpy")
def scratch(shapes: Shapes) -> Scratch:
    """Returns the scratch of a model, with the arm's root where it stands."""
    work = _allocated(shapes)
    _stand(shapes, work, shapes.root, 0)
    return work


@njit(nogil=True, error_model="numpy")
def _allocated(shapes: Shapes) -> Scratch:
    joints, reach_m = np.zeros((len(shapes.chain) + 2, 12)), np.full(1, SLACK_M)
    if shapes.margin_m.size:
        reach_m[0] += max(0.0, shapes.margin_m.max())
    eight = np.zeros((shapes.box_m.shape[1] + 7) // 8, dtype=np.uint64)
    return Scratch(
        joints,
        shapes.box_m.copy(),
        shapes.place.copy(),
        np.empty((4, 3)),
        np.empty(4),
        eight.view(np.uint8),
        eight,
        np.empty((len(shapes.margin_m), 3)),
        np.zeros(len(shapes.margin_m), dtype=np.bool_),
        np.empty((shapes.margin_m.size, 2), dtype=np.int64),
        np.empty((1, len(shapes.chain))),
        reach_m,
    )


@compiled
def check(
    shapes: Shapes, poses: Floats, roots: Floats, until_other: bool, answers: NDArray[np.uint8]
) -> int:
    """Checks arm poses (B, J); writes `HIT`, `FREE` or `UNSURE` (B,) uint8.

    Args:
        shapes: The model.
        poses: Arm poses [rad].
        roots: Pose of the arm's root for each (B, 12), or for all (1, 12); see `Shapes`.
        until_other: Whether to stop at the first pose that is not free.
        answers: The answers.

    Returns:
        The number of poses checked.
    """
    work = _allocated(shapes)
    for b in range(len(poses)):
        if b < len(roots):
            _stand(shapes, work, roots, b)
        answers[b] = answer(shapes, poses, b, work)
        if until_other and answers[b] != FREE:
            return b + 1
    return len(poses)


@compiled
def undecided(shapes: Shapes, poses: Floats, pairs: Ints, answers: NDArray[np.uint8]) -> int:
    """Writes the pairs (P, 2) that are not `FREE` at the first arm pose, and their answers (P,).

    Returns:
        Their number.
    """
    work, statics, found = scratch(shapes), shapes.box_m.shape[1], 0
    _move(shapes, poses, 0, work)
    for g in range(-1, len(shapes.member)):
        count = _with_scene(shapes, work, g) if g >= 0 else _within(shapes, work)
        for p in range(count):
            i, j = work.todo[p, 0], work.todo[p, 1]
            _place(shapes, work, i)
            _place(shapes, work, j)
            said = _pair(shapes, work, i, j, float(shapes.margin_m[i - statics, j]))
            if said != FREE:
                pairs[found, 0], pairs[found, 1], answers[found] = i, j, said
                found += 1
    return found
