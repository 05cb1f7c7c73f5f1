"""RRT-Connect and shortcuts in the arm's joint space, compiled by numba.

Poses that the collision kernel is unsure of count as blocked. `work` is the scratch of `Scratch`.
"""

from __future__ import annotations

from math import ceil, sqrt

import numpy as np

from hab_spa.planning.batch import FREE, Floats, Ints, Scratch, Shapes
from hab_spa.planning.gjk import called
from hab_spa.planning.kernel import answer, compiled, scratch


@called
def _far(a: Floats, i: int, b: Floats, j: int) -> float:
    """Returns the Euclidean distance of two poses."""
    total = 0.0
    for k in range(a.shape[1]):
        total += (a[i, k] - b[j, k]) ** 2
    return sqrt(total)


@called
def _between(a: Floats, i: int, b: Floats, j: int, share: float, out: Floats, n: int) -> None:
    """Writes the pose at a share of the way between two."""
    for k in range(a.shape[1]):
        out[n, k] = a[i, k] + (b[j, k] - a[i, k]) * share


@called
def _nearest(tree: Floats, size: int, poses: Floats, j: int) -> int:
    best, least = 0, 1e30
    for i in range(size):
        total = 0.0
        for k in range(tree.shape[1]):
            total += (tree[i, k] - poses[j, k]) ** 2
            # Squares only add up: most nodes are out after two or three joints.
            if total >= least:
                break
        if total < least:
            best, least = i, total
    return best


@called
def _is_free(
    shapes: Shapes, a: Floats, i: int, b: Floats, j: int, resolution: float, work: Scratch,
    checks: Ints,
) -> bool:  # fmt: skip
    """Whether the straight edge between two poses is free, but for its first pose."""
    steps = max(1, ceil(_far(a, i, b, j) / resolution))
    # The end, then the middle, then the quarters: few blocked edges are so near their start.
    stride = 1
    while stride < steps:
        stride *= 2
    step = steps
    while stride:
        while step <= steps:
            _between(a, i, b, j, step / steps, work.pose, 0)
            checks[0] += 1
            if answer(shapes, work.pose, 0, work) != FREE:
                return False
            step += 2 * stride
        stride //= 2
        step = stride
    return True


@called
def _extend(
    shapes: Shapes, tree: Floats, parent: Ints, size: int, near: int, target: Floats, j: int,
    most: float, resolution: float, work: Scratch, checks: Ints,
) -> int:  # fmt: skip
    """Adds a step from a node towards a target.

    Returns:
        1 if it reached the target, 0 if it came nearer, -1 if it is blocked.
    """
    far = _far(tree, near, target, j)
    share = min(1.0, most / max(far, 1e-12))
    _between(tree, near, target, j, share, tree, size)
    if not _is_free(shapes, tree, near, tree, size, resolution, work, checks):
        return -1
    parent[size] = near
    return 1 if share == 1.0 else 0


@compiled
def connect(
    shapes: Shapes, trees: Floats, parents: Ints, samples: Floats, most: float, resolution: float,
    most_checks: int, checks: Ints,
) -> tuple[int, int]:  # fmt: skip
    """Grows two trees towards random poses and each other (Kuffner and LaValle 2000).

    Args:
        shapes: The model.
        trees: (2, K, J) nodes; the first of each is its root.
        parents: (2, K) int64 parent of each node.
        samples: (R, J) the random poses.
        most: Maximum length of a step [rad].
        resolution: Resolution of the checks along an edge [rad].
        most_checks: Maximum number of checks.
        checks: (1,) number of checks, counted up.

    Returns:
        The nodes of the trees that are equal; (-1, -1) if the trees have not met.
    """
    work, sizes = scratch(shapes), np.ones(2, dtype=np.int64)
    for r in range(len(samples)):
        a, b = r % 2, 1 - r % 2
        if checks[0] >= most_checks or sizes.max() + 1 >= trees.shape[1]:
            break
        near = _nearest(trees[a], sizes[a], samples, r)
        said = _extend(
            shapes, trees[a], parents[a], sizes[a], near, samples, r, most, resolution, work, checks
        )
        if said < 0:
            continue
        sizes[a] += 1
        new, said = sizes[a] - 1, 0
        near = _nearest(trees[b], sizes[b], trees[a], new)
        while said == 0 and sizes[b] + 1 < trees.shape[1]:
            said = _extend(
                shapes, trees[b], parents[b], sizes[b], near, trees[a], new, most, resolution,
                work, checks,
            )  # fmt: skip
            if said >= 0:
                near = sizes[b]
                sizes[b] += 1
        if said == 1:
            return (new, near) if a == 0 else (near, new)
    return -1, -1


@compiled
def first_free(
    shapes: Shapes, start: Floats, goals: Floats, resolution: float, checks: Ints
) -> int:
    """Returns the first of some poses (G, J) that the edge from (1, J) reaches; -1 if none."""
    work = scratch(shapes)
    if answer(shapes, start, 0, work) != FREE:
        return -1
    for i in range(len(goals)):
        if _is_free(shapes, start, 0, goals, i, resolution, work, checks):
            return i
    return -1


@called
def _cut(
    shapes: Shapes, path: Floats, size: int, draw: Floats, d: int, joint: int, resolution: float,
    other: Floats, work: Scratch, checks: Ints,
) -> int:  # fmt: skip
    """Straightens a path between two random points, in one joint or, for -1, in all.

    Returns:
        The new number of poses; `other` is scratch.
    """
    first, last = min(draw[d, 0], draw[d, 1]) * (size - 1), max(draw[d, 0], draw[d, 1]) * (size - 1)
    i, k = int(first), int(last)
    # Two points of one edge have nothing to straighten between them.
    if i == k or k + 1 >= size:
        return size
    _between(path, i, path, i + 1, first - i, other, 0)
    count = 1
    if joint >= 0:
        for n in range(i + 1, k + 1):
            _between(path, n, path, n, 0.0, other, count)
            count += 1
    _between(path, k, path, k + 1, last - k, other, count)
    count += 1
    # Poses between are kept for one joint only; else there are none, and `joint` -1 is not used.
    for n in range(1, count - 1):
        share = (i + n - first) / (last - first)
        other[n, joint] = other[0, joint] + (other[count - 1, joint] - other[0, joint]) * share
    if i + 1 + count + size - k - 1 > len(path):
        return size
    for n in range(count - 1):
        if not _is_free(shapes, other, n, other, n + 1, resolution, work, checks):
            return size
    rest = size - k - 1
    for n in range(rest):
        _between(path, k + 1 + n, path, k + 1 + n, 0.0, other, count + n)
    for n in range(count + rest):
        _between(other, n, other, n, 0.0, path, i + 1 + n)
    return i + 1 + count + rest


@called
def _thin(
    shapes: Shapes, path: Floats, size: int, resolution: float, work: Scratch, checks: Ints
) -> int:
    """Removes poses that a path can do without; returns their new number."""
    i = 1
    while i < size - 1:
        if not _is_free(shapes, path, i - 1, path, i + 1, resolution, work, checks):
            i += 1
            continue
        for n in range(i, size - 1):
            _between(path, n + 1, path, n + 1, 0.0, path, n)
        size -= 1
    return size


@called
def _length(path: Floats, size: int) -> float:
    total = 0.0
    for i in range(size - 1):
        total += _far(path, i, path, i + 1)
    return total


@compiled
def shorten(
    shapes: Shapes, path: Floats, size: int, draws: Floats, passes: int, gain: float,
    resolution: float, checks: Ints,
) -> int:  # fmt: skip
    """Shortens a path in place by thinning and random straight lines, in all joints or in one.

    Args:
        shapes: The model.
        path: (K, J) room for the path.
        size: Number of its poses.
        draws: (R, 3) uniform random numbers, shared out over the passes.
        passes: Maximum number of passes.
        gain: A pass that shortens the path by less than this fraction is the last.
        resolution: Resolution of the checks along an edge [rad].
        checks: (1,) number of checks, counted up.

    Returns:
        The new number of poses.
    """
    work, other, each = scratch(shapes), np.empty_like(path), len(draws) // passes
    joints = path.shape[1]
    length = _length(path, size)
    for p in range(passes):
        size = _thin(shapes, path, size, resolution, work, checks)
        for d in range(p * each, (p + 1) * each):
            joint = int(draws[d, 2] * 2 * joints) - joints  # half of them in one joint
            joint = max(joint, -1)
            size = _cut(shapes, path, size, draws, d, joint, resolution, other, work, checks)
        before, length = length, _length(path, size)
        if length > (1.0 - gain) * before:
            break
    return _thin(shapes, path, size, resolution, work, checks)
