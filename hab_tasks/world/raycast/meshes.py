"""Triangles of visuals, as the renderer would draw them."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trimesh
from numpy.typing import NDArray

from hab_tasks.geometry import to_matrix
from hab_tasks.world.scenes.fields import read_bytes
from hab_tasks.world.scenes.meshes import read_mesh
from hab_tasks.world.scenes.visuals import Visual, Visuals

_GLB_HEADER = "<4sII"
_CHUNK_HEADER = "<II"


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
    data = read_bytes(file)
    start = struct.calcsize(_GLB_HEADER)
    length, _ = struct.unpack_from(_CHUNK_HEADER, data, start)
    start += struct.calcsize(_CHUNK_HEADER)
    header = json.loads(data[start : start + length])
    materials = header.get("materials", [])
    numbers = [p.get("material") for mesh in header["meshes"] for p in mesh["primitives"]]
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
