"""Decimation of textured meshes that preserves the texture.

Decimation moves vertices across the seams of a texture atlas, which smears it. Every remaining
triangle is therefore assigned to the atlas chart nearest to its centre, and each of its corners
takes the texture coordinate of the nearest vertex of that chart.
"""

from __future__ import annotations

from typing import Any

import fast_simplification
import numpy as np
import trimesh
from PIL import Image, ImageDraw
from scipy import ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree
from trimesh.visual import TextureVisuals

_APART_M = 100.0
"""Distance put between charts so that a search stays within one of them."""


def decimate_textured(mesh: Any, triangles: int) -> Any:
    """Returns a copy of a textured trimesh mesh with at most about `triangles` faces.

    Args:
        mesh: A mesh whose `visual` has `uv` and `material`, vertices doubled along seams.
        triangles: Target number of faces; a mesh with fewer is returned unchanged.
    """
    if len(mesh.faces) <= triangles:
        return mesh
    welded = trimesh.Trimesh(mesh.vertices, mesh.faces, process=True)
    corners_m: Any = welded.vertices.astype(np.float32)
    simplified = fast_simplification.simplify(
        corners_m,
        welded.faces.astype(np.int32),
        target_reduction=1.0 - triangles / len(welded.faces),
    )
    points, faces = simplified[:2]
    vertices, uv = np.asarray(mesh.vertices), np.asarray(mesh.visual.uv)
    charts = _charts(np.asarray(mesh.faces), len(vertices))
    _, nearest_face = KDTree(vertices[mesh.faces].mean(axis=1)).query(points[faces].mean(axis=1))
    face_chart = charts[np.asarray(mesh.faces)[nearest_face, 0]]
    corners = points[faces].reshape(-1, 3)
    tree = KDTree(np.column_stack((vertices, _APART_M * charts)))
    _, nearest = tree.query(np.column_stack((corners, _APART_M * np.repeat(face_chart, 3))))
    light = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False)
    smooth = trimesh.Trimesh(points, faces, process=False).vertex_normals[faces].reshape(-1, 3)
    light.vertex_normals = smooth
    light.visual = TextureVisuals(uv=uv[nearest], material=mesh.visual.material)
    return light


def fill_background(image: Image.Image, mesh: Any) -> Image.Image:
    """Returns the texture with the colour of the nearest chart wherever no triangle of `mesh` lies.

    Scanned atlases are black between their charts; shrunk or decimated, that black bleeds in.
    """
    pixels = np.asarray(image)
    height, width = pixels.shape[:2]
    covered = Image.new("1", (width, height), 0)
    draw = ImageDraw.Draw(covered)
    uv = np.asarray(mesh.visual.uv) * (1.0, -1.0) + (0.0, 1.0)
    for triangle in (uv * (width, height))[mesh.faces]:
        draw.polygon([tuple(corner) for corner in triangle], fill=1)
    # A chart's outermost pixels are half background already.
    inside: Any = ndimage.binary_erosion(np.asarray(covered), iterations=2)
    nearest: Any = ndimage.distance_transform_edt(
        ~inside, return_distances=False, return_indices=True
    )
    return Image.fromarray(pixels[nearest[0], nearest[1]])


def _charts(faces: Any, count: int) -> Any:
    """Returns the chart number of every vertex: vertices joined by faces share one."""
    edges = np.concatenate((faces[:, [0, 1]], faces[:, [1, 2]]))
    ones = np.ones(len(edges), dtype=bool)
    graph = coo_matrix((ones, (edges[:, 0], edges[:, 1])), shape=(count, count))
    return connected_components(graph, directed=False)[1]
