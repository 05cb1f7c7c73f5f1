"""Closed convex collision shapes with exact, hand-laid triangles."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import ConvexHull

from hab_authoring.apartment.model import Array, Box, Convex
from hab_authoring.apartment.shapes import rotation_matrix

HULL_DIGITS = 6

_HEX_FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip


def hexahedron(corners: Array) -> Convex:
    """Return the solid of eight corners in (x, y, z) binary order; its six faces are planar."""
    return _outward(Convex(np.asarray(corners, float), _HEX_FACES.copy()))


def from_box(box: Box) -> Convex:
    """Return a box as a convex mesh."""
    signs = np.array(list(np.ndindex(2, 2, 2))) - 0.5
    return hexahedron(signs * np.asarray(box.size) + np.asarray(box.center))


def frustum(
    bottom_radius_m: float,
    top_radius_m: float,
    bottom_m: float,
    top_m: float,
    sides: int = 16,
    center_xz: tuple[float, float] = (0.0, 0.0),
) -> Convex:
    """Return an upright prism whose corners lie on the cone, so that it touches the true rim."""
    angle = np.arange(sides) * 2 * np.pi / sides
    ring = np.stack([np.cos(angle), np.zeros(sides), np.sin(angle)], axis=1)
    low = ring * bottom_radius_m + [center_xz[0], bottom_m, center_xz[1]]
    high = ring * top_radius_m + [center_xz[0], top_m, center_xz[1]]
    return _outward(Convex(np.vstack([low, high]), _prism_faces(sides)))


def prism(outline_xz: list[tuple[float, float]], bottom_m: float, top_m: float) -> Convex:
    """Return an upright prism over a convex outline."""
    flat = np.array([[x, 0.0, z] for x, z in outline_xz])
    both = np.vstack([flat + np.array([0, y, 0]) for y in (bottom_m, top_m)])
    return _outward(Convex(both, _prism_faces(len(outline_xz))))


def ring(
    bottom: tuple[float, float], top: tuple[float, float], height: tuple[float, float], pieces: int
) -> list[Convex]:
    """Return a ring wall of convex pieces; `bottom` and `top` hold (inner, outer) radius."""
    angle = np.arange(pieces + 1) * 2 * np.pi / pieces
    out = []
    for first, second in pairwise(angle):
        corners = [
            (radius * np.cos(t), y, radius * np.sin(t))
            for t in (first, second)
            for y, radii in ((height[0], bottom), (height[1], top))
            for radius in radii
        ]
        out.append(hexahedron(np.array(corners)))
    return out


def ball(radii: tuple[float, float, float], rings: int = 5, sides: int = 10) -> Convex:
    """Return a convex ellipsoid with a flat foot and crown, so that it stands stably."""
    cap_rad = np.radians(68.0)
    polar = np.linspace(-cap_rad, cap_rad, rings)
    angle = np.arange(sides) * 2 * np.pi / sides
    rows = [
        np.stack(
            [
                np.cos(t) * np.cos(angle),
                np.full(sides, np.sin(t) / np.sin(cap_rad)),
                np.cos(t) * np.sin(angle),
            ],
            axis=1,
        )
        for t in polar
    ]
    last = (rings - 1) * sides
    faces = [[0, k, k + 1] for k in range(1, sides - 1)]
    faces += [[last, last + k, last + k + 1] for k in range(1, sides - 1)]
    for i in range(sides):
        j = (i + 1) % sides
        for row in range(rings - 1):
            a, b = row * sides + i, row * sides + j
            faces += [[a, b, b + sides], [a, b + sides, a + sides]]
    return _outward(Convex(np.vstack(rows) * np.asarray(radii), np.array(faces)))


def hull(points: ArrayLike) -> Convex:
    """Return the convex hull of points (N, 3); no three corners of it may be nearly in line."""
    corners: Array = np.unique(np.asarray(points, np.float64).round(HULL_DIGITS), axis=0)
    found = ConvexHull(corners)
    used = np.unique(found.simplices)
    return _outward(Convex(corners[used], np.searchsorted(used, found.simplices)))


def rotated(solid: Convex, axis: str, angle_rad: float) -> Convex:
    """Return the solid turned about a coordinate axis through the origin."""
    return Convex(solid.vertices @ rotation_matrix(axis, angle_rad).T, solid.faces)


def centroid(pieces: Sequence[Convex]) -> Array:
    """Return the common centroid (3,) of closed pieces of one density."""
    volume, moment = 0.0, np.zeros(3)
    for piece in pieces:
        a, b, c = (piece.vertices[piece.faces[:, k]] for k in range(3))
        signed = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6
        volume += float(signed.sum())
        moment += signed @ (a + b + c) / 4
    return moment / volume


def moved(solid: Convex, offset: tuple[float, float, float] | Array) -> Convex:
    """Return the solid shifted by `offset`."""
    return Convex(solid.vertices + np.asarray(offset), solid.faces)


def _prism_faces(sides: int) -> NDArray[np.int64]:
    faces = [[0, k, k + 1] for k in range(1, sides - 1)]
    faces += [[sides, sides + k, sides + k + 1] for k in range(1, sides - 1)]
    for i in range(sides):
        j = (i + 1) % sides
        faces += [[i, j, sides + j], [i, sides + j, sides + i]]
    return np.array(faces)


def _outward(solid: Convex) -> Convex:
    corner = solid.vertices[solid.faces]
    flat = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    wrong = np.einsum("ij,ij->i", flat, corner.mean(axis=1) - solid.vertices.mean(axis=0)) < 0
    faces = solid.faces.copy()
    faces[wrong] = faces[wrong][:, ::-1]
    return Convex(solid.vertices, faces)
