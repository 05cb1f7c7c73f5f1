"""Mesh files: bounds, convex parts and light copies, kept in the cache by content.

The user's dataset is never written to. Decimation preserves textures: it moves vertices across the
seams of a texture atlas, which smears it, so every remaining triangle is assigned to the atlas
chart nearest to its centre, and its corners take the coordinates of the chart's nearest vertices.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import fast_simplification
import numpy as np
import trimesh
from PIL import Image, ImageDraw
from scipy import ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree, QhullError
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from hab_tasks.errors import DatasetError
from hab_tasks.io.cache import cached, cached_file
from hab_tasks.world.scenes.fields import read_bytes
from hab_tasks.world.scenes.mesh_checks import LARGEST_M, check_mesh

TEXTURE_SIZE_PX = 512
TEXTURED_TRIANGLES = 1500
"""YCB's scans have 16,384 triangles each, more than a furnished room."""

SINGLE_HULL_EXCESS = 1.15
"""A decomposition whose common hull is at most this much larger than its parts becomes one hull."""


@lru_cache(maxsize=1024)
def content_key(file: Path) -> str:
    """Returns a short hash of the file's bytes."""
    return hashlib.sha256(read_bytes(file)).hexdigest()[:20]


@lru_cache(maxsize=1024)
def mesh_bounds(file: Path) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Returns (centre, half size) [m] of a mesh file's axis-aligned box in its own frame."""
    low, high = read_mesh(file).bounds
    center, half = (low + high) / 2, (high - low) / 2
    return tuple(map(float, center)), tuple(map(float, half))  # type: ignore[return-value]


def convex_parts(file: Path) -> list[trimesh.Trimesh]:
    """Returns a mesh file's convex parts: one a mesh, or one a connected piece of STL/PLY/OBJ.

    Raises:
        DatasetError: The file cannot be read, or a part of it has no volume.
    """
    scene = read_mesh(file)
    pieces: list[trimesh.Trimesh] = []
    meshes: list[Any] = scene.dump()
    for mesh in meshes:
        if file.suffix.lower() in (".stl", ".ply", ".obj"):
            pieces.extend(mesh.split(only_watertight=False))
        else:
            pieces.append(mesh)
    try:
        hulls = [piece.convex_hull for piece in pieces if len(piece.vertices) >= 4]
    except QhullError as error:
        raise DatasetError(
            f"{file}: a part of it is flat, so nothing can collide with it."
        ) from error
    if not hulls or not sum(hull.volume for hull in hulls) > 0:
        raise DatasetError(f"{file}: holds no volume to collide with.")
    return hulls


def parts_file(file: Path) -> tuple[Path, float]:
    """Returns a GLB with one mesh for each convex part of `file`, and their total volume [m^3].

    Near-convex decompositions (`SINGLE_HULL_EXCESS`) become one hull: a can made of sixty hulls
    costs time and collides no better.
    """

    def write(path: Path) -> None:
        hulls = convex_parts(file)
        joined: Any = trimesh.util.concatenate(hulls)
        whole = joined.convex_hull
        if whole.volume <= SINGLE_HULL_EXCESS * sum(hull.volume for hull in hulls):
            hulls = [whole]
        scene = trimesh.Scene()
        for index, hull in enumerate(hulls):
            scene.add_geometry(hull, node_name=f"part_{index:03d}", geom_name=f"part_{index:03d}")
        glb: Any = scene.export(file_type="glb")
        path.write_bytes(glb)

    def read(path: Path) -> tuple[Path, float]:
        return path, parts_volume(path)

    return cached(f"parts/{content_key(file)}.glb", write, read)


def textured_glb(file: Path) -> Path:
    """Returns a light GLB copy of a textured OBJ: `TEXTURED_TRIANGLES`, `TEXTURE_SIZE_PX`.

    YCB's material files name ``texture_map.jpg`` with a blank behind it, which SAPIEN takes for
    part of the name; and a texture of 4096 pixels for a tin costs more memory than the whole room.
    """

    def write(path: Path) -> None:
        mesh, image = read_textured(file)
        image.thumbnail((2 * TEXTURE_SIZE_PX, 2 * TEXTURE_SIZE_PX))
        image = fill_background(image, mesh)
        image.thumbnail((TEXTURE_SIZE_PX, TEXTURE_SIZE_PX))
        mesh.visual.material = PBRMaterial(
            baseColorTexture=image, metallicFactor=0.0, roughnessFactor=0.7
        )
        light = decimate_textured(mesh, TEXTURED_TRIANGLES)
        path.write_bytes(light.export(file_type="glb"))

    key = f"{content_key(file)}-{TEXTURE_SIZE_PX}-{TEXTURED_TRIANGLES}"
    return cached_file(f"visual/{key}.glb", write, check_mesh)


def read_textured(file: Path) -> tuple[Any, Image.Image]:
    """Reads an OBJ with one texture; returns the mesh, vertices doubled along seams, and its image.

    Raises:
        DatasetError: The mesh, its material or its image is absent or damaged.
    """
    mesh: Any = _loaded(file, partial(trimesh.load_mesh, process=False))
    image: Any = getattr(getattr(mesh.visual, "material", None), "image", None)
    # Where there is none, trimesh puts an empty image that comes from no file.
    if getattr(image, "format", None) is None or getattr(mesh.visual, "uv", None) is None:
        raise DatasetError(f"{file}: its material or texture is absent or cannot be read.")
    try:
        return mesh, image.convert("RGB")
    except (OSError, SyntaxError, ValueError) as error:
        raise DatasetError(f"{file}: its texture cannot be read ({error}).") from error


@lru_cache(maxsize=1024)
def parts_volume(file: Path) -> float:
    """Returns the summed volume [m^3] of the convex parts in a mesh file."""
    return float(sum(hull.volume for hull in convex_parts(file)))


@lru_cache(maxsize=4096)
def check_any_mesh(file: Path) -> None:
    """Raises DatasetError when a mesh file of any format cannot be read."""
    check_mesh(file)
    if file.suffix.lower() != ".glb":
        read_mesh(file)


def read_mesh(file: Path, *, process: bool = True) -> trimesh.Scene:
    """Reads a mesh file without its materials.

    Raises:
        DatasetError: It is damaged, holds no mesh or corners that are not finite.
    """
    if process and file.suffix.lower() != ".glb":
        read_mesh(file, process=False)  # corners that are not finite would be left out
    options = {"skip_materials": True, "process": process}
    return _loaded(file, partial(trimesh.load_scene, **options))


def _loaded(file: Path, load: Callable[[Path], Any]) -> Any:
    check_mesh(file)
    try:
        found = load(file)
        is_empty, bounds = found.is_empty, found.bounds
    # The readers raise arbitrary errors for damaged files.
    except Exception as error:
        raise DatasetError(f"{file}: cannot be read as a mesh ({error}).") from error
    if is_empty or bounds is None or not (np.abs(bounds) <= LARGEST_M).all():
        raise DatasetError(f"{file}: holds no mesh, or one that is not finite.")
    return found


_APART_M = 100.0
"""Distance put between charts so that a search stays within one of them."""


def decimate_textured(mesh: Any, triangles: int) -> Any:
    """Returns a copy of a textured trimesh mesh with at most about `triangles` faces.

    Its `visual` has `uv` and `material`, and its vertices are doubled along seams.
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
