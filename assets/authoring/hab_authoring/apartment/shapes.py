"""Visible shapes: bevelled boxes, soft boxes, turned shapes, tubes, leaves.

Every edge is broken by a small bevel whose normals blend from one face to the next, because a
perfectly sharp edge catches no light and reads as unreal.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hab_authoring.apartment.model import Array, Part, Vec3

AXES = {"x": 0, "y": 1, "z": 2}


def box(center: Vec3, size: Vec3, material: str, bevel_m: float = 0.004) -> Part:
    """Return a box with one bevel facet per edge: 24 vertices and 44 triangles."""
    half = np.asarray(size, float) / 2
    bevel = min(bevel_m, 0.4 * float(half.min()))
    positions, normals, index = [], [], {}
    for axis in range(3):
        for corner in np.ndindex(2, 2, 2):
            sign = np.array(corner) * 2.0 - 1.0
            inset = half - bevel
            inset[axis] = half[axis]
            index[(axis, *corner)] = len(positions)
            positions.append(sign * inset)
            normals.append(np.eye(3)[axis] * sign)
    quads = [_face_quad(index, axis, side) for axis in range(3) for side in range(2)]
    triangles: list[list[int]] = []
    if bevel > 0:
        quads += [
            _edge_quad(index, axis, s, t) for axis in range(3) for s in range(2) for t in range(2)
        ]
        triangles = [[index[(axis, *c)] for axis in range(3)] for c in np.ndindex(2, 2, 2)]
    for a, b, c, d in quads:
        triangles += [[a, b, c], [a, c, d]]
    points = np.array(positions)
    part = Part(
        points + np.asarray(center),
        np.array(normals),
        _box_uv(points, np.array(normals), half, center),
        np.array(triangles),
        material,
    )
    return oriented(part)


def _face_quad(index: dict[tuple[int, ...], int], axis: int, side: int) -> list[int]:
    ring = [(0, 0), (0, 1), (1, 1), (1, 0)]
    return [index[(axis, *_corner(axis, side, pair))] for pair in ring]


def _edge_quad(index: dict[tuple[int, ...], int], axis: int, s: int, t: int) -> list[int]:
    first, second = [a for a in range(3) if a != axis]
    low, high = _corner(axis, 0, (s, t)), _corner(axis, 1, (s, t))
    return [
        index[(first, *low)],
        index[(first, *high)],
        index[(second, *high)],
        index[(second, *low)],
    ]


def _corner(axis: int, side: int, pair: tuple[int, int]) -> tuple[int, ...]:
    corner = list(pair)
    corner.insert(axis, side)
    return tuple(corner)


def _box_uv(points: Array, normals: Array, half: Array, center: Vec3) -> Array:
    """Project each face; u runs along the longest side, so that wood grain follows the board."""
    grain = int(np.argmax(half))
    uv = np.zeros((len(points), 2))
    for row, normal in enumerate(np.abs(normals)):
        others = [a for a in range(3) if a != int(np.argmax(normal))]
        if grain in others:
            others.sort(key=lambda a: a != grain)
        uv[row] = points[row, others]
    # Two equal boards side by side must not show the same knots.
    return uv + np.array([center[0] * 1.7 + center[1] * 2.3, center[2] * 1.9 + center[1] * 0.7])


def soft_box(
    center: Vec3, size: Vec3, material: str, radius_m: float, bulge_m: float = 0.0, steps: int = 2
) -> Part:
    """Return a box with rounded edges, its faces optionally bulging like a cushion."""
    half = np.asarray(size, float) / 2
    radius = min(radius_m, float(half.min()) * 0.999)
    positions, faces, normals, thin = [], [], [], int(np.argmin(half))
    inner = [3 if bulge_m and axis != thin else 0 for axis in range(3)]
    grids = [_soft_ticks(h, radius, steps, n) for h, n in zip(half, inner, strict=True)]
    for axis in range(3):
        u_axis, v_axis = [a for a in range(3) if a != axis]
        for side in (-1.0, 1.0):
            start, n_v = len(positions), len(grids[v_axis])
            for u in grids[u_axis]:
                for v in grids[v_axis]:
                    point = np.zeros(3)
                    point[axis], point[u_axis], point[v_axis] = side * half[axis], u, v
                    core = np.clip(point, radius - half, half - radius)
                    normal = point - core
                    normal /= np.linalg.norm(normal)
                    swell = bulge_m * float(axis == thin) * _swell(core, half - radius, axis)
                    positions.append(core + normal * (radius + swell))
                    normals.append(normal)
            faces += _grid_faces(start, len(grids[u_axis]), n_v)
    points = np.array(positions)
    part = Part(points, np.array(normals), np.zeros((len(points), 2)), np.array(faces), material)
    part = oriented(part)
    part = replace(part, normals=_smooth_normals(part), uv_m=_triplanar_uv(points, part.normals))
    return moved(part, center)


def _swell(core: Array, reach: Array, axis: int) -> float:
    """Return how far out a cushion's broad face is: 1 in the middle, 0 along its border."""
    share = 1 - (core / np.maximum(reach, 1e-9)) ** 2
    return float(np.prod(np.delete(share, axis)))


def _soft_ticks(half: float, radius: float, steps: int, inner: int) -> Array:
    angles = np.linspace(0, np.pi / 4, steps + 1)
    border = radius * (1 - np.tan(angles[::-1]))
    low = -half + border[:-1] if half - radius < 1e-9 else -half + border
    middle = np.linspace(radius - half, half - radius, inner + 2)[1:-1]
    return np.unique(np.round(np.concatenate([low, middle, -low]), 9))


def _grid_faces(start: int, n_u: int, n_v: int) -> list[list[int]]:
    faces = []
    for i in range(n_u - 1):
        for j in range(n_v - 1):
            a = start + i * n_v + j
            faces += [[a, a + 1, a + n_v + 1], [a, a + n_v + 1, a + n_v]]
    return faces


def _triplanar_uv(points: Array, normals: Array) -> Array:
    dominant = np.argmax(np.abs(normals), axis=1)
    others = np.array([[2, 1], [0, 2], [0, 1]])[dominant]
    return np.take_along_axis(points, others, axis=1)


def _smooth_normals(part: Part) -> Array:
    """Average face normals over vertices at the same place, seams included."""
    corner = part.positions[part.faces]
    area_normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    _, group = np.unique(np.round(part.positions, 6), axis=0, return_inverse=True)
    total = np.zeros((group.max() + 1, 3))
    for k in range(3):
        np.add.at(total, group.ravel()[part.faces[:, k]], area_normal)
    summed = total[group.ravel()]
    return summed / np.maximum(np.linalg.norm(summed, axis=1, keepdims=True), 1e-12)


def lathe(
    chains: Sequence[Sequence[tuple[float, float]]],
    material: str,
    sides: int = 24,
    center: Vec3 = (0.0, 0.0, 0.0),
    axis: str = "y",
) -> Part:
    """Turn profile chains of (radius, height) about an axis; edges between chains stay sharp.

    A profile runs so that the outside is on its right-hand side going up.
    """
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    positions, normals, uvs, faces = [], [], [], []
    for chain in chains:
        profile = np.asarray(chain, float)
        slope = np.diff(profile, axis=0)
        flat = np.stack([slope[:, 1], -slope[:, 0]], axis=1)
        flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-12)
        blend = np.vstack([flat[:1], flat[:-1] + flat[1:], flat[-1:]])
        blend /= np.maximum(np.linalg.norm(blend, axis=1, keepdims=True), 1e-12)
        run = np.concatenate([[0.0], np.cumsum(np.linalg.norm(slope, axis=1))])
        start = sum(len(p) for p in positions)
        for (radius, height), (n_r, n_h), v in zip(profile, blend, run, strict=True):
            positions.append(
                np.stack([radius * np.cos(angle), 0 * angle + height, radius * np.sin(angle)], 1)
            )
            normals.append(np.stack([n_r * np.cos(angle), 0 * angle + n_h, n_r * np.sin(angle)], 1))
            uvs.append(np.stack([angle * max(float(profile[:, 0].max()), 1e-3), 0 * angle + v], 1))
        faces += _grid_faces(start, len(profile), sides + 1)
    part = Part(np.vstack(positions), np.vstack(normals), np.vstack(uvs), np.array(faces), material)
    return moved(turned(_without_slivers(oriented(part)), axis), center)


def cylinder(
    center: Vec3,
    radius_m: float,
    height_m: float,
    material: str,
    axis: str = "y",
    sides: int = 20,
    bevel_m: float = 0.002,
    top_radius_m: float | None = None,
) -> Part:
    """Return a cylinder or cone frustum with bevelled rims, centred on `center`."""
    top = radius_m if top_radius_m is None else top_radius_m
    h, b = height_m / 2, min(bevel_m, height_m / 3, radius_m / 2, top / 2)
    chains = [
        [(0.0, -h), (radius_m - b, -h)],
        [(radius_m - b, -h), (radius_m, -h + b)],
        [(radius_m, -h + b), (top, h - b)],
        [(top, h - b), (top - b, h)],
        [(top - b, h), (0.0, h)],
    ]
    return lathe(chains, material, sides, center, axis)


def tube(points: Sequence[Vec3], radius_m: float, material: str, sides: int = 10) -> Part:
    """Sweep a circle along a polyline, with closed ends."""
    path = np.asarray(points, float)
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.cross(tangent[0], np.eye(3)[int(np.argmin(np.abs(tangent[0])))])
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    rings, normals, uvs = [], [], []
    run = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    for place, direction, v in zip(path, tangent, run, strict=True):
        side = side - direction * float(side @ direction)
        side /= np.linalg.norm(side)
        other = np.cross(direction, side)
        normal = np.outer(np.cos(angle), side) + np.outer(np.sin(angle), other)
        rings.append(place + radius_m * normal)
        normals.append(normal)
        uvs.append(np.stack([angle * radius_m, 0 * angle + v], 1))
    for row, sign in ((0, -1.0), (-1, 1.0)):
        cap = np.vstack([np.repeat(path[row][None], sides + 1, 0)])
        rings += [rings[row], cap]
        normals += [np.repeat(sign * tangent[row][None], sides + 1, 0)] * 2
        uvs += [uvs[row], uvs[row]]
    faces, width, n = [], sides + 1, len(path)
    faces += _grid_faces(0, n, width)
    faces += _grid_faces(n * width, 2, width) + _grid_faces((n + 2) * width, 2, width)
    part = Part(np.vstack(rings), np.vstack(normals), np.vstack(uvs), np.array(faces), material)
    return _without_slivers(oriented(part))


def sphere(center: Vec3, radii: Vec3, material: str, rings: int = 10, sides: int = 16) -> Part:
    """Return an ellipsoid."""
    polar = np.linspace(-np.pi / 2, np.pi / 2, rings + 1)
    ball = lathe([[(float(np.cos(t)), float(np.sin(t))) for t in polar]], material, sides)
    scale = np.asarray(radii)
    normals = ball.normals / scale
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return moved(
        replace(ball, positions=ball.positions * scale, normals=normals, uv_m=ball.uv_m * radii[0]),
        center,
    )


def printed(width: float, depth: float, height: float, material: str) -> Part:
    """Return a picture seen from above, stretched once over a rectangle at `height`."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [width / 2, depth / 2]
    points = np.stack([corners[:, 0], np.full(4, height), corners[:, 1]], axis=1)
    uv = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])
    return Part(
        points, np.tile([0.0, 1.0, 0.0], (4, 1)), uv, np.array([[0, 2, 1], [0, 3, 2]]), material
    )


def smoothed(part: Part) -> Part:
    """Return the part with normals averaged from its faces, after it was bent."""
    return replace(part, normals=_smooth_normals(part))


def moved(part: Part, offset: Vec3 | Array) -> Part:
    """Return the part shifted by `offset`."""
    return replace(part, positions=part.positions + np.asarray(offset))


def rotated(part: Part, axis: str, angle_rad: float) -> Part:
    """Return the part turned about a coordinate axis through the origin."""
    rotation = rotation_matrix(axis, angle_rad)
    return replace(part, positions=part.positions @ rotation.T, normals=part.normals @ rotation.T)


def rotation_matrix(axis: str, angle_rad: float) -> Array:
    """Return the right-handed rotation about a coordinate axis."""
    c, s = float(np.cos(angle_rad)), float(np.sin(angle_rad))
    i, j = [(1, 2), (2, 0), (0, 1)][AXES[axis]]
    rotation = np.eye(3)
    rotation[i, i] = rotation[j, j] = c
    rotation[i, j], rotation[j, i] = -s, s
    return rotation


def turned(part: Part, axis: str) -> Part:
    """Return a part built along +y so that it runs along `axis`."""
    if axis == "x":
        return rotated(part, "z", -np.pi / 2)
    return rotated(part, "x", np.pi / 2) if axis == "z" else part


def oriented(part: Part) -> Part:
    """Return the part with every triangle wound to agree with its normals."""
    corner = part.positions[part.faces]
    flat = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    wrong = np.einsum("ij,ij->i", flat, part.normals[part.faces].sum(axis=1)) < 0
    faces: NDArray[np.int64] = part.faces.copy()
    faces[wrong] = faces[wrong][:, ::-1]
    return replace(part, faces=faces)


def _without_slivers(part: Part) -> Part:
    corner = part.positions[part.faces]
    area = np.linalg.norm(
        np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1
    )
    return replace(part, faces=part.faces[area > 1e-12])
