"""Shapes over an outline: upright prisms, and skins drawn over a row of sections."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from hab_authoring.apartment import shapes
from hab_authoring.apartment.model import Part, Vec3


def rounded_rectangle(
    half_x: float, half_z: float, corner: float, steps: int
) -> list[tuple[float, float]]:
    """Return a rectangle's outline (x, z), its corners rounded in `steps` points each."""
    out = []
    for sx, sz, start in ((1, 1, 0.0), (-1, 1, 0.5), (-1, -1, 1.0), (1, -1, 1.5)):
        for k in range(steps):
            angle = math.pi * (start + 0.5 * k / (steps - 1))
            out.append(
                (
                    sx * (half_x - corner) + corner * math.cos(angle),
                    sz * (half_z - corner) + corner * math.sin(angle),
                )
            )
    return out


def extruded(
    outline: list[tuple[float, float]], low: float, high: float, grow: float, material: str
) -> list[Part]:
    """Return an upright prism over an outline (x, z) around the origin, grown outwards."""
    ring = np.array([*outline, outline[0]])
    step = np.gradient(ring, axis=0)
    step[0] = step[-1] = ring[1] - ring[-2]
    out = np.stack([step[:, 1], -step[:, 0]], axis=1)
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    ring = ring + grow * out
    n = len(ring)
    points = np.vstack([np.insert(ring, 1, y, axis=1) for y in (low, high)])
    normals = np.vstack([np.insert(out, 1, 0.0, axis=1)] * 2)
    faces = [f for k in range(n - 1) for f in ([k, k + n, k + n + 1], [k, k + n + 1, k + 1])]
    parts = [Part(points, normals, points[:, :2], np.array(faces), material)]
    for y, up in ((low, -1.0), (high, 1.0)):
        cap = np.insert(ring[:-1], 1, y, axis=1)
        fan = np.array([[0, k + 1, k] if up > 0 else [0, k, k + 1] for k in range(1, n - 2)])
        parts.append(Part(cap, np.tile([0.0, up, 0.0], (n - 1, 1)), cap[:, [0, 2]], fan, material))
    return parts


def loft(sections: Sequence[ArrayLike], material: str) -> Part:
    """Return a smooth skin over closed sections of (N, 3) points each, with closed ends."""
    rings = np.asarray(sections, float)
    count, n = rings.shape[:2]
    middles = rings[[0, -1]].mean(axis=1)
    points = np.vstack([rings.reshape(-1, 3), middles])
    faces = []
    for k in range(count - 1):
        for i in range(n):
            a, b = k * n + i, k * n + (i + 1) % n
            faces += [[a, b, b + n], [a, b + n, a + n]]
    first, last = count * n, count * n + 1
    for i in range(n):
        j = (i + 1) % n
        faces += [[first, j, i], [last, (count - 1) * n + i, (count - 1) * n + j]]
    tri = np.array(faces)
    a, b, c = (points[tri[:, k]] for k in range(3))
    if float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) < 0:
        tri = tri[:, ::-1]
    uv = points[:, [0, 1]] + points[:, [2, 2]]
    part = Part(points, np.zeros_like(points), uv, tri, material)
    return shapes.smoothed(part)


def bent(points: Sequence[Vec3], count: int) -> list[Vec3]:
    """Return `count` points of a smooth curve through the given ones, evenly along it."""
    path = np.asarray(points, float)
    run = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    curve = CubicSpline(run, path)(np.linspace(0.0, run[-1], count))
    return [(float(x), float(y), float(z)) for x, y, z in curve]


def slab(first: ArrayLike, second: ArrayLike, material: str) -> Part:
    """Return a flat-shaded prism between two equal convex outlines of (N, 3) points."""
    a, b = np.asarray(first, float), np.asarray(second, float)
    n = len(a)
    quads = [np.array([a[i], a[(i + 1) % n], b[(i + 1) % n], b[i]]) for i in range(n)]
    points, normals, faces = [], [], []
    middle = (a.mean(axis=0) + b.mean(axis=0)) / 2
    for polygon in [a, b, *quads]:
        normal = np.cross(polygon[1] - polygon[0], polygon[2] - polygon[0])
        normal /= np.linalg.norm(normal)
        if float(normal @ (polygon.mean(axis=0) - middle)) < 0:
            normal = -normal
        start = sum(len(p) for p in points)
        points.append(polygon)
        normals.append(np.tile(normal, (len(polygon), 1)))
        faces += [[start, start + k, start + k + 1] for k in range(1, len(polygon) - 1)]
    place, normal = np.vstack(points), np.vstack(normals)
    uv = np.where(np.abs(normal[:, :1]) > 0.5, place[:, [1, 2]], place[:, [1, 0]])
    return shapes.oriented(Part(place, normal, uv, np.array(faces), material))
