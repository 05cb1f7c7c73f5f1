"""Triangle meshes of all bodies of this process, in clusters; each mesh is read and kept once.

Layouts and environments share the meshes: a body refers to its surface by number and has only a
pose of its own. Triangles are those that the renderer would draw.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trimesh
from numpy.typing import NDArray

from hab_tasks.geometry import to_matrix
from hab_tasks.world.raycast.compiled import kernel
from hab_tasks.world.scenes.fields import read_bytes
from hab_tasks.world.scenes.meshes import glb_document, read_mesh
from hab_tasks.world.scenes.visuals import Visual, Visuals


class Mesh(NamedTuple):
    """Triangles in the body's frame.

    Attributes:
        vertices_m: (V, 3) float32.
        faces: (F, 3) int32, anticlockwise from outside.
        two_sided: (F,) whether the back of a face is visible.
    """

    vertices_m: NDArray[np.float32]
    faces: NDArray[np.int32]
    two_sided: NDArray[np.bool_]


def mesh_of(visuals: Visuals) -> Mesh:
    """Returns the triangles of all visuals.

    Raises:
        DatasetError: A mesh file is damaged.
    """
    parts = [part for visual in visuals for part in _parts(visual)]
    starts = np.cumsum([0, *(len(part.vertices_m) for part in parts)])
    faces = [part.faces + start for part, start in zip(parts, starts[:-1], strict=True)]
    return Mesh(
        np.concatenate([np.zeros((0, 3)), *(p.vertices_m for p in parts)]).astype(np.float32),
        np.concatenate([np.zeros((0, 3)), *faces]).astype(np.int32),
        np.concatenate([np.zeros(0, dtype=bool), *(part.two_sided for part in parts)]),
    )


def _parts(visual: Visual) -> list[Mesh]:
    """Returns the triangles of each part of a visual."""
    body_from_visual, scale = to_matrix(visual.body_from_visual), np.ones(3)
    if visual.file is None:
        pieces = [(_primitive(visual), np.eye(4), False)]
    else:
        pieces, scale = _read(visual.file), np.asarray(visual.size)
    parts = []
    for mesh, visual_from_mesh, two_sided in pieces:
        points = _mapped(visual_from_mesh, np.asarray(mesh.vertices)) * scale
        faces = np.asarray(mesh.faces, dtype=np.int32)
        if np.linalg.det(visual_from_mesh[:3, :3]) < 0:  # a mirrored part
            faces = faces[:, ::-1]
        points = _mapped(body_from_visual, points).astype(np.float32)
        parts.append(Mesh(points, faces, np.full(len(faces), two_sided)))
    return parts


def _read(file: Path) -> list[tuple[Any, NDArray[np.float64], bool]]:
    """Returns mesh, pose with scale (4, 4) and whether it is two-sided, of a file's parts."""
    scene: Any = read_mesh(file, process=False)
    names = list(scene.geometry)
    flags = _two_sided(file)
    if len(flags) != len(names):
        flags = [bool(flags) and all(flags)] * len(names)
    placed = [scene.graph[node] for node in scene.graph.nodes_geometry]
    return [
        (scene.geometry[name], np.asarray(matrix), flags[names.index(name)])
        for matrix, name in placed
        if hasattr(scene.geometry[name], "faces")
    ]


def _two_sided(file: Path) -> list[bool]:
    """Returns whether the material of each of a GLB's primitives is double-sided."""
    if file.suffix.lower() != ".glb":
        return []
    document, _ = glb_document(file, read_bytes(file))
    materials = document.get("materials", [])
    numbers = [p.get("material") for mesh in document["meshes"] for p in mesh["primitives"]]
    return [n is not None and bool(materials[n].get("doubleSided", False)) for n in numbers]


def _primitive(visual: Visual) -> Any:
    size = visual.size
    if visual.kind == "box":
        return trimesh.creation.box(extents=2.0 * np.asarray(size))
    if visual.kind == "sphere":
        return trimesh.creation.icosphere(subdivisions=3, radius=size[0])
    if visual.kind == "cylinder":
        return trimesh.creation.cylinder(radius=size[0], height=2.0 * size[1])
    return trimesh.creation.capsule(radius=size[0], height=2.0 * size[1])


def _mapped(b_from_a: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    return points @ b_from_a[:3, :3].T + b_from_a[:3, 3]


Floats = NDArray[np.float32]
Integers = NDArray[np.int32]

_MORTON_BITS = 10


@dataclass(frozen=True, eq=False)
class Clusters:
    """A surface in clusters of neighbouring triangles; see `kernel.Surfaces`.

    Attributes:
        vertices_m: (V, 3) in the body's frame.
        faces: (F, 3) counted from the cluster's first vertex.
        clusters: (C, 5) as in the kernel, counted from the surface's first vertex and face.
        spheres_m: (C, 4) centre and radius of each cluster's bounding sphere.
        bound_m: (4,) centre and radius of the surface's bounding sphere.
    """

    vertices_m: Floats
    faces: Integers
    clusters: Integers
    spheres_m: Floats
    bound_m: Floats


class SurfaceLibrary:
    """Surfaces by number."""

    def __init__(self) -> None:
        """Creates an empty library."""
        self._numbers: dict[Visuals, int] = {}
        self._surfaces: list[Clusters] = []
        self._joined: Any = None

    def number(self, visuals: Visuals) -> int:
        """Returns the number of the surface with these visuals; reads their meshes if it is new."""
        if visuals not in self._numbers:
            self._surfaces.append(in_clusters(mesh_of(visuals), kernel().CLUSTER_FACES))
            self._numbers[visuals] = len(self._surfaces) - 1
            self._joined = None
        return self._numbers[visuals]

    def surfaces(self) -> Any:
        """Returns all surfaces as `kernel.Surfaces`."""
        if self._joined is None:
            self._joined = _joined(self._surfaces)
        return self._joined


@lru_cache(maxsize=1)
def library() -> SurfaceLibrary:
    """Returns the library of this process."""
    return SurfaceLibrary()


def in_clusters(mesh: Mesh, faces_each: int) -> Clusters:
    """Splits a mesh into clusters of at most `faces_each` neighbouring, equally visible faces."""
    middles_m = mesh.vertices_m[mesh.faces].mean(axis=1)
    order = np.lexsort((_morton(middles_m), mesh.two_sided))
    one_sided = len(order) - int(mesh.two_sided.sum())
    vertices: list[Any] = [np.zeros((0, 3))]
    indices: list[Any] = [np.zeros((0, 3))]
    clusters, spheres = [], []
    starts = [*range(0, one_sided, faces_each), *range(one_sided, len(order), faces_each)]
    first_vertex = 0
    for first, end in zip(starts, [*starts[1:], len(order)], strict=True):
        used, index = np.unique(mesh.faces[order[first:end]], return_inverse=True)
        points = mesh.vertices_m[used]
        clusters.append((first_vertex, len(used), first, end - first, first >= one_sided))
        spheres.append(_sphere(points))
        vertices.append(points)
        indices.append(index.reshape(-1, 3))
        first_vertex += len(used)
    return Clusters(
        np.concatenate(vertices).astype("f4"),
        np.concatenate(indices).astype("i4"),
        np.array(clusters, dtype=np.int32).reshape(-1, 5),
        np.array(spheres, dtype=np.float32).reshape(-1, 4),
        np.array(_sphere(mesh.vertices_m), dtype=np.float32),
    )


def _sphere(points_m: Floats) -> tuple[float, ...]:
    """Returns centre and radius of a bounding sphere, the radius rounded up."""
    if not len(points_m):
        return (0.0, 0.0, 0.0, -np.inf)  # never in view
    centre = (points_m.min(axis=0) + points_m.max(axis=0)) / 2
    radius = float(np.linalg.norm(points_m - centre, axis=1).max())
    return (*centre.tolist(), 1.0001 * radius + 1e-5)


def _morton(points_m: Floats) -> NDArray[np.int64]:
    """Returns the positions of points (P, 3) along a space-filling curve."""
    if not len(points_m):
        return np.zeros(0, dtype=np.int64)
    low = points_m.min(axis=0)
    span_m = max(float((points_m - low).max()), 1e-9)
    cells = ((points_m - low) / span_m * (2**_MORTON_BITS - 1)).astype(np.int64)
    codes = np.zeros(len(points_m), dtype=np.int64)
    for bit in range(_MORTON_BITS):
        for axis in range(3):
            codes |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return codes


def _joined(surfaces: list[Clusters]) -> Any:
    """Returns the surfaces as one `kernel.Surfaces`."""
    clusters, ranges = [], []
    vertices = faces = first = 0
    for surface in surfaces:
        clusters.append(surface.clusters + np.array([vertices, 0, faces, 0, 0], dtype=np.int32))
        ranges.append((first, first + len(surface.clusters)))
        vertices, faces = vertices + len(surface.vertices_m), faces + len(surface.faces)
        first += len(surface.clusters)
    return kernel().Surfaces(
        vertices_m=np.ascontiguousarray(np.concatenate([s.vertices_m for s in surfaces]).T),
        faces=np.concatenate([surface.faces for surface in surfaces]),
        clusters=np.concatenate(clusters),
        spheres_m=np.concatenate([surface.spheres_m for surface in surfaces]),
        ranges=np.array(ranges, dtype=np.int32),
        bounds_m=np.stack([surface.bound_m for surface in surfaces]),
    )
