"""GJK (Gilbert, Johnson, Keerthi 1988) between two shapes, compiled by numba."""

from __future__ import annotations

from math import sqrt
from typing import Any

from numba import njit

from hab_spa.planning.batch import FREE, HIT, HULL, OUTER, UNSURE, Floats, Point, Shapes

SLACK_M, CLOSER_M = 2e-5, 2e-3
"""Coal is asked about distances above the margin by less than the one, below it by the other: it
is exact to a micrometre, but overestimates the distances of some hulls by a millimetre."""

STEPS = 40
"""Maximum number of GJK iterations; most pairs need 2 to 6."""

# Without numba's counts of references, which take longer than the work: none of these allocates.
OPTIONS: Any = {"nogil": True, "error_model": "numpy", "_nrt": False}
fast = njit(**OPTIONS, fastmath={"nnan", "ninf", "nsz", "reassoc"})
called = njit(**OPTIONS)
# Calls pass every array as many values, which costs more than the work on two distant shapes.
inlined = njit(**OPTIONS, forceinline=True)


@fast
def _furthest(vertices_m: Floats, first: int, last: int, x: float, y: float, z: float) -> int:
    """Returns the vertex furthest in a direction."""
    best, most = first, -1e30
    for i in range(first, last):
        along = x * vertices_m[0, i] + y * vertices_m[1, i] + z * vertices_m[2, i]
        if along > most:
            best, most = i, along
    return best


@inlined
def turned(poses: Floats, i: int, x: float, y: float, z: float) -> Point:
    """Returns a direction in the frame of a pose."""
    return (
        poses[i, 0] * x + poses[i, 3] * y + poses[i, 6] * z,
        poses[i, 1] * x + poses[i, 4] * y + poses[i, 7] * z,
        poses[i, 2] * x + poses[i, 5] * y + poses[i, 8] * z,
    )


@inlined
def out_of(poses: Floats, i: int, x: float, y: float, z: float) -> Point:
    """Returns a point given in the frame of a pose."""
    return (
        poses[i, 0] * x + poses[i, 1] * y + poses[i, 2] * z + poses[i, 9],
        poses[i, 3] * x + poses[i, 4] * y + poses[i, 5] * z + poses[i, 10],
        poses[i, 6] * x + poses[i, 7] * y + poses[i, 8] * z + poses[i, 11],
    )


@inlined
def _support(shapes: Shapes, item: int, placed: Floats, x: float, y: float, z: float) -> Point:
    """Returns the point of a shape furthest in a direction."""
    local_m, span, vertices_m = shapes.local_m, shapes.span, shapes.vertices_m
    x, y, z = turned(placed, item, x, y, z)
    if span[item, 2] == HULL:
        i = _furthest(vertices_m, span[item, 0], span[item, 1], x, y, z)
        return out_of(placed, item, vertices_m[0, i], vertices_m[1, i], vertices_m[2, i])
    return out_of(
        placed,
        item,
        local_m[item, 3] if x > 0.0 else local_m[item, 0],
        local_m[item, 4] if y > 0.0 else local_m[item, 1],
        local_m[item, 5] if z > 0.0 else local_m[item, 2],
    )


@inlined
def dot(a: Point, b: Point) -> float:
    """Returns the dot product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def to(a: Point, b: Point) -> Point:
    """Returns the vector from one point to another."""
    return b[0] - a[0], b[1] - a[1], b[2] - a[2]


@inlined
def _corner(w: Floats, i: int) -> Point:
    return w[i, 0], w[i, 1], w[i, 2]


@inlined
def _on_segment(a: Point, b: Point) -> tuple[float, float]:
    """Returns the weights of two points for the point of their segment nearest to the origin."""
    ab = to(a, b)
    length2 = dot(ab, ab)
    t = 0.0 if length2 == 0.0 else -dot(a, ab) / length2
    t = min(1.0, max(0.0, t))
    return 1.0 - t, t


@inlined
def _on_triangle(a: Point, b: Point, c: Point) -> Point:
    """As `_on_segment`, for a triangle (Ericson 2005, 5.1.5)."""
    ab, ac = to(a, b), to(a, c)
    d1, d2 = -dot(ab, a), -dot(ac, a)
    if d1 <= 0.0 and d2 <= 0.0:
        return 1.0, 0.0, 0.0
    d3, d4 = -dot(ab, b), -dot(ac, b)
    if d3 >= 0.0 and d4 <= d3:
        return 0.0, 1.0, 0.0
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        s, t = _on_segment(a, b)
        return s, t, 0.0
    d5, d6 = -dot(ab, c), -dot(ac, c)
    if d6 >= 0.0 and d5 <= d6:
        return 0.0, 0.0, 1.0
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        s, t = _on_segment(a, c)
        return s, 0.0, t
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        s, t = _on_segment(b, c)
        return 0.0, s, t
    whole = va + vb + vc
    if whole <= 0.0:  # a degenerate triangle
        s, t = _on_segment(a, b)
        return s, t, 0.0
    return va / whole, vb / whole, vc / whole


@inlined
def _beyond(a: Point, b: Point, c: Point, d: Point) -> float:
    """Returns how far [m] the origin is beyond a face, as seen from the opposite corner `d`.

    Negative inside; positive also for flat tetrahedra.
    """
    ab, ac = to(a, b), to(a, c)
    n = (
        ab[1] * ac[2] - ab[2] * ac[1],
        ab[2] * ac[0] - ab[0] * ac[2],
        ab[0] * ac[1] - ab[1] * ac[0],
    )
    length = sqrt(dot(n, n))
    height = dot(n, to(a, d))
    if length < 1e-12 or abs(height) < 1e-9 * length:
        return 1.0
    origin = -dot(n, a) / length
    return -origin if height > 0.0 else origin


@inlined
def _set(weight: Floats, i: int, s: float, j: int, t: float, k: int, u: float) -> None:
    for corner in range(4):
        weight[corner] = 0.0
    weight[i], weight[j], weight[k] = s, t, u


@called
def _nearest(w: Floats, count: int, weight: Floats) -> float:
    """Writes the weights (4,) of the simplex's point nearest to the origin.

    Returns:
        The depth [m] of the origin within a tetrahedron; 0 outside.
    """
    if count == 1:
        _set(weight, 0, 1.0, 1, 0.0, 2, 0.0)
    elif count == 2:
        s, t = _on_segment(_corner(w, 0), _corner(w, 1))
        _set(weight, 0, s, 1, t, 2, 0.0)
    elif count == 3:
        s, t, u = _on_triangle(_corner(w, 0), _corner(w, 1), _corner(w, 2))
        _set(weight, 0, s, 1, t, 2, u)
    else:
        best, depth = 1e30, 1e30
        for other in range(4):
            i, j, k = (other + 1) % 4, (other + 2) % 4, (other + 3) % 4
            a, b, c = _corner(w, i), _corner(w, j), _corner(w, k)
            beyond = _beyond(a, b, c, _corner(w, other))
            depth = min(depth, -beyond)
            if beyond < 0.0:
                continue
            s, t, u = _on_triangle(a, b, c)
            gap2 = 0.0
            for axis in range(3):
                gap2 += (s * a[axis] + t * b[axis] + u * c[axis]) ** 2
            if gap2 < best:
                best = gap2
                _set(weight, i, s, j, t, k, u)
        return max(depth, 0.0)
    return 0.0


@inlined
def _reduced(w: Floats, count: int, weight: Floats) -> tuple[int, Point]:
    """Keeps the points of a simplex with a weight; returns their number and weighted sum."""
    kept, x, y, z = 0, 0.0, 0.0, 0.0
    for i in range(count):
        if weight[i] > 0.0:
            x += weight[i] * w[i, 0]
            y += weight[i] * w[i, 1]
            z += weight[i] * w[i, 2]
            w[kept, 0], w[kept, 1], w[kept, 2] = w[i, 0], w[i, 1], w[i, 2]
            kept += 1
    return kept, (x, y, z)


@called
def gjk(
    shapes: Shapes,
    placed: Floats,
    first: int,
    second: int,
    margin_m: float,
    v: Point,
    w: Floats,
    weight: Floats,
) -> int:
    """Compares the distance of two shapes with a margin, from a direction v between them."""
    radius_m = shapes.local_m[first, 6] + shapes.local_m[second, 6]
    over_m = radius_m + max(margin_m, 0.0) + SLACK_M
    # A negative margin lets shapes overlap, whose depth coal tells; and boxes around shapes may
    # overlap where the shapes do not.
    exact = margin_m >= 0.0 and shapes.span[first, 2] != OUTER and shapes.span[second, 2] != OUTER
    under_m = radius_m + margin_m - CLOSER_M
    count, gap2 = 0, dot(v, v)
    for _ in range(STEPS):
        a = _support(shapes, first, placed, -v[0], -v[1], -v[2])
        b = _support(shapes, second, placed, v[0], v[1], v[2])
        w[count, 0], w[count, 1], w[count, 2] = a[0] - b[0], a[1] - b[1], a[2] - b[2]
        along = dot(v, _corner(w, count))
        if along > 0.0 and along * along > gap2 * over_m * over_m:
            return FREE
        # No point lies nearer, so that this is the distance, and too near the margin to decide.
        if count and gap2 - along <= 1e-12 * gap2:
            return UNSURE
        count += 1
        depth = _nearest(w, count, weight)
        if depth > 0.0:
            return HIT if exact and depth + under_m > 0.0 else UNSURE
        count, v = _reduced(w, count, weight)
        gap2 = dot(v, v)
        if exact and under_m > 0.0 and gap2 < under_m * under_m:
            return HIT
        # The origin is on the simplex: the shapes just touch, and rounding would decide.
        if gap2 < 1e-20 or count == 4:
            return UNSURE
    return UNSURE
