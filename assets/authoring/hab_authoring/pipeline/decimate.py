"""Decimation of meshes with attributes, without interpolating texture coordinates or normals.

Decimation merges vertices. Every remaining triangle is one of the mesh's own: its corners move to
the position of the vertices they were merged with, and take all other attributes (texture
coordinate, normal, colour) from the nearest of these on the same chart of the texture. Vertices
doubled along seams, and all materials of one mesh, are welded first, so no crack can open between
them. Where a surface or its texture would move too far, more triangles are kept.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import fast_simplification
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

MEAN_SHIFT, MAX_SHIFT = 0.0025, 0.02
"""Maximum mean and maximum shift of the surface, as shares of the mesh's diagonal."""

MAX_TURN_RAD = 0.35
"""A corner whose normal leans so much more than before from its triangle's takes the latter."""

FEWEST_TRIANGLES = 500
"""Minimum number of triangles; fewer would save nothing, and be visible."""

_MORE = 1.5
_SAMPLES = 1000

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Surface:
    """A textured mesh.

    Attributes:
        points: (V, 3) positions, in any unit; doubled along seams and hard edges.
        faces: (F, 3) triangles.
        uv: (V, 2) texture coordinates, None without a texture.
        normals: (V, 3) unit normals, None to leave them out of account.
    """

    points: Floats
    faces: Ints
    uv: Floats | None
    normals: Floats | None


@dataclass(frozen=True, kw_only=True, eq=False)
class Thinned:
    """A thinned mesh in terms of the vertices and triangles of the original.

    Attributes:
        faces: (K,) which triangles are left.
        position: (K, 3) whose position each of their corners takes.
        attribute: (K, 3) whose other attributes it takes.
        flat: (K, 3) whether its normal is the triangle's instead.
    """

    faces: Ints
    position: Ints
    attribute: Ints
    flat: NDArray[np.bool_]


def thin(surface: Surface, fraction: float) -> Thinned:
    """Decimates to a fraction of the triangles, in (0, 1], or to as many as the shape requires."""
    faces = surface.faces
    weld = _number(surface.points)
    chart = _charts(
        _number(weld if surface.uv is None else np.column_stack((weld, surface.uv))), faces
    )
    wanted = max(fraction * len(faces), FEWEST_TRIANGLES)
    while wanted < len(faces):
        kept, position, attribute = _merge(surface, weld, chart, int(wanted))
        if len(kept) and _is_near(surface, chart, kept, position):
            attribute = _best_normals(surface, weld, chart, kept, attribute)
            flat = _leaning(surface, kept, position, attribute)
            return Thinned(faces=kept, position=position, attribute=attribute, flat=flat)
        wanted *= _MORE
    everything = np.arange(len(faces))
    return Thinned(
        faces=everything, position=faces, attribute=faces, flat=np.zeros_like(faces, bool)
    )


def face_normals(points: Floats, faces: Ints) -> Floats:
    """Returns the unit normals (K, 3) of triangles (K, 3); zero for those without an area."""
    a, b, c = (points[faces[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)


def _merge(surface: Surface, weld: Ints, chart: Ints, triangles: int) -> tuple[Ints, Ints, Ints]:
    """Returns the triangles left, and whose position and attributes their corners take."""
    points, faces = surface.points, surface.faces
    corners: Any = np.zeros((weld.max() + 1, 3), dtype=np.float32)
    corners[weld] = points
    solid: Any = weld[faces][_is_triangle(weld[faces])].astype(np.int32)
    simplified: Any = fast_simplification.simplify(
        corners, solid, target_count=triangles, return_collapses=True
    )
    merged, _, group_of_weld = fast_simplification.replay_simplification(
        corners, solid, simplified[2]
    )
    group = np.asarray(group_of_weld)[weld]
    kept = np.flatnonzero(_is_triangle(group[faces]))
    # Of the vertices merged into one, the nearest to where the decimation put them stands for all;
    # one on a seam goes first, because it is on every chart that meets there.
    distance = np.linalg.norm(points - np.asarray(merged)[group], axis=1)
    middle = _first_of(group, (distance, -_charts_at(weld, chart)))[group]
    distance = np.linalg.norm(points - points[middle], axis=1)
    label = _number(np.column_stack((group, chart)))
    nearest = _first_of(label, (distance,))[label]
    return kept, middle[faces[kept]], nearest[faces[kept]]


def _best_normals(surface: Surface, weld: Ints, chart: Ints, kept: Ints, attribute: Ints) -> Ints:
    """Returns, of the vertices at the same place and on the same chart, those of likest normals."""
    if surface.normals is None:
        return attribute
    label = _number(np.column_stack((weld, chart)))
    order = np.argsort(label, kind="stable")
    size = np.bincount(label)
    first = np.cumsum(size) - size
    before = surface.normals[surface.faces[kept]]
    best, likest = attribute, np.full(attribute.shape, -np.inf)
    for step in range(size.max()):
        place = label[attribute]
        candidate = order[first[place] + np.minimum(step, size[place] - 1)]
        likeness = (surface.normals[candidate] * before).sum(axis=2)
        best = np.where(likeness > likest + 1e-6, candidate, best)
        likest = np.maximum(likeness, likest)
    return best


def _leaning(surface: Surface, kept: Ints, position: Ints, attribute: Ints) -> NDArray[np.bool_]:
    """Returns (K, 3) which corners' normals lean much more from their triangle than before."""
    if surface.normals is None:
        return np.zeros(attribute.shape, dtype=bool)
    faces = surface.faces[kept]
    before = _angles(surface.normals[faces], face_normals(surface.points, faces))
    after = _angles(surface.normals[attribute], face_normals(surface.points, position))
    return after > before + MAX_TURN_RAD


def _angles(corners: Floats, faces: Floats) -> Floats:
    return np.arccos(np.clip((corners * faces[:, None]).sum(axis=2), -1.0, 1.0))


def _is_near(surface: Surface, chart: Ints, kept: Ints, position: Ints) -> bool:
    """Returns whether a thinned surface is near the original's, each chart near its own."""
    diagonal = np.linalg.norm(np.ptp(surface.points, axis=0))
    shifts = [_distances(surface.points, surface.faces, position)]
    chart_before, chart_after = chart[surface.faces[:, 0]], chart[surface.faces[kept, 0]]
    for number in np.unique(chart_after):
        own = position[chart_after == number]
        samples = max(20, _SAMPLES * len(own) // len(position))
        shifts.append(
            _distances(surface.points, own, surface.faces[chart_before == number], samples)
        )
    shift = np.concatenate(shifts)
    return bool(shift.mean() <= MEAN_SHIFT * diagonal and shift.max() <= MAX_SHIFT * diagonal)


def _distances(points: Floats, faces: Ints, others: Ints, samples: int = _SAMPLES) -> Floats:
    """Returns how far samples on some triangles are from other ones."""
    mesh = trimesh.Trimesh(points, faces, process=False)
    other = trimesh.Trimesh(points, others, process=False)
    if mesh.area <= 0:
        return np.zeros(1)
    on_mesh = trimesh.sample.sample_surface(mesh, samples, seed=0)[0]
    return trimesh.proximity.closest_point(other, on_mesh)[1]


def _first_of(label: Ints, keys: tuple[Floats | Ints, ...]) -> Ints:
    """Returns the index of every label's first member when sorted by the keys, the last first."""
    order = np.lexsort((*keys, label))
    found = np.zeros(label.max() + 1, dtype=np.int64)
    found[label[order][::-1]] = order[::-1]
    return found


def _number(rows: NDArray[Any]) -> Ints:
    """Returns a number for every row; equal rows share one."""
    return np.unique(rows, axis=0, return_inverse=True)[1].reshape(-1)


def _is_triangle(faces: Ints) -> NDArray[np.bool_]:
    a, b, c = faces.T
    return (a != b) & (b != c) & (c != a)


def _charts(vertex: Ints, faces: Ints) -> Ints:
    """Returns the chart number of every vertex: vertices joined by triangles share one."""
    joined = vertex[faces]
    edges = np.concatenate((joined[:, [0, 1]], joined[:, [1, 2]]))
    count = vertex.max() + 1
    graph = coo_matrix((np.ones(len(edges), bool), (edges[:, 0], edges[:, 1])), (count, count))
    return connected_components(graph, directed=False)[1][vertex].astype(np.int64)


def _charts_at(weld: Ints, chart: Ints) -> Ints:
    """Returns how many charts meet at the place of every vertex."""
    pairs = np.unique(np.column_stack((weld, chart)), axis=0)
    return np.bincount(pairs[:, 0], minlength=weld.max() + 1)[weld]
