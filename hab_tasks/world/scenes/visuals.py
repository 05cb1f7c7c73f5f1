"""Visual geometry of bodies as data, for sensors that work without a renderer; light scans.

Decimation of scans preserves textures: it moves vertices across the seams of a texture atlas, which
smears it, so every remaining triangle is assigned to the atlas chart nearest to its centre, and its
corners take the coordinates of the chart's nearest vertices.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree

import fast_simplification
import numpy as np
import trimesh
from PIL import Image, ImageDraw
from scipy import ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree
from transforms3d.euler import euler2quat
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from hab_tasks.errors import DatasetError
from hab_tasks.geometry import IDENTITY, Pose7, pose
from hab_tasks.io.cache import cached_file
from hab_tasks.world.scenes.meshes import check_mesh, content_key, loaded_mesh
from hab_tasks.world.scenes.spec import ArticulationInstance, ObjectTemplate, Stage
from hab_tasks.world.scenes.urdf import sapien_urdf

VisualKind = Literal["mesh", "box", "sphere", "cylinder", "capsule"]


@dataclass(frozen=True, kw_only=True)
class Visual:
    """One visual shape of a body.

    Attributes:
        kind: Its shape.
        body_from_visual: Its pose; cylinders and capsules extend along z.
        file: The mesh file, None for other shapes.
        size: Scale of a mesh along its axes; half extents of a box [m]; radius of a sphere [m];
            radius and half length of a cylinder, or of a capsule between its caps [m].
    """

    kind: VisualKind
    body_from_visual: Pose7 = IDENTITY
    file: Path | None = None
    size: tuple[float, ...] = (1.0, 1.0, 1.0)


Visuals = tuple[Visual, ...]


def visual_file(template: ObjectTemplate) -> Path | None:
    """Returns the mesh file to draw for a template: scans with a large texture as a light copy."""
    file = template.visual_file
    return textured_glb(file) if file is not None and file.suffix == ".obj" else file


def template_visuals(template: ObjectTemplate, scale: float) -> Visuals:
    """Returns the visuals of an object."""
    file = visual_file(template)
    return () if file is None else (Visual(kind="mesh", file=file, size=(scale,) * 3),)


def stage_visuals(stage: Stage) -> Visuals:
    """Returns the visuals of floor and walls."""
    if stage.visual_file is not None:
        return (Visual(kind="mesh", file=stage.visual_file),)
    return tuple(
        Visual(
            kind="box", body_from_visual=(*source.center_m, *IDENTITY[3:]), size=source.half_size_m
        )
        for source in stage.collision
    )


def furniture_visuals(furniture: ArticulationInstance) -> dict[str, Visuals]:
    """Returns link name -> visuals of articulated furniture."""
    text = sapien_urdf(furniture.urdf_file, visuals=True, bars=furniture.bars)
    return urdf_visuals(text, furniture.scale)


def urdf_visuals(text: str, scale: float = 1.0) -> dict[str, Visuals]:
    """Returns link name -> visuals of a URDF with absolute mesh paths."""
    root = ElementTree.fromstring(text)
    return {
        link.get("name", ""): tuple(
            shape for visual in link.findall("visual") for shape in _shapes(visual, scale)
        )
        for link in root.findall("link")
    }


def _shapes(visual: ElementTree.Element, scale: float) -> Visuals:
    geometry = visual.find("geometry")
    if geometry is None:
        return ()
    origin = visual.find("origin")
    at: Pose7 = IDENTITY
    if origin is not None:
        xyz = [scale * x for x in _numbers(origin, "xyz", (0.0,) * 3)]
        roll, pitch, yaw = _numbers(origin, "rpy", (0.0,) * 3)
        at = pose(tuple(xyz), euler2quat(roll, pitch, yaw))
    return tuple(_shape(shape, at, scale) for shape in geometry)


def _shape(shape: ElementTree.Element, at: Pose7, scale: float) -> Visual:
    if shape.tag == "mesh":
        sizes = [scale * x for x in _numbers(shape, "scale", (1.0,) * 3)]
        sizes = sizes * 3 if len(sizes) == 1 else sizes
        file = Path(shape.get("filename", ""))
        return Visual(kind="mesh", body_from_visual=at, file=file, size=tuple(sizes))
    if shape.tag == "box":
        half = tuple(scale * x / 2 for x in _numbers(shape, "size", (0.0,) * 3))
        return Visual(kind="box", body_from_visual=at, size=half)
    radius = scale * float(shape.get("radius", 0.0))
    if shape.tag == "sphere":
        return Visual(kind="sphere", body_from_visual=at, size=(radius,))
    kind: VisualKind = "capsule" if shape.tag == "capsule" else "cylinder"
    size = (radius, scale * float(shape.get("length", 0.0)) / 2)
    return Visual(kind=kind, body_from_visual=at, size=size)


def _numbers(
    element: ElementTree.Element, name: str, default: tuple[float, ...]
) -> tuple[float, ...]:
    text = element.get(name)
    return default if text is None else tuple(float(x) for x in text.split())


TEXTURE_SIZE_PX = 512
TEXTURED_TRIANGLES = 1500
"""YCB's scans have 16,384 triangles each, more than a furnished room."""


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
    mesh: Any = loaded_mesh(file, partial(trimesh.load_mesh, process=False))
    image: Any = getattr(getattr(mesh.visual, "material", None), "image", None)
    # Where there is none, trimesh puts an empty image that comes from no file.
    if getattr(image, "format", None) is None or getattr(mesh.visual, "uv", None) is None:
        raise DatasetError(f"{file}: its material or texture is absent or cannot be read.")
    try:
        return mesh, image.convert("RGB")
    except (OSError, SyntaxError, ValueError) as error:
        raise DatasetError(f"{file}: its texture cannot be read ({error}).") from error


_APART_M = 100.0
"""Distance put between charts so that a search stays within one of them."""


def decimate_textured(mesh: Any, triangles: int) -> Any:
    """Returns a copy of a textured trimesh mesh with at most about `triangles` faces.

    Its `visual` has `uv` and `material`, and its vertices are doubled along seams.
    """
    if len(mesh.faces) <= triangles:
        return mesh
    welded = trimesh.Trimesh(mesh.vertices, mesh.faces, process=True)
    points, faces = simplified(welded, triangles / len(welded.faces))
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


def simplified(mesh: trimesh.Trimesh, share: float) -> tuple[Any, Any]:
    """Returns the corners and faces of a welded mesh with about this share of its faces."""
    points: Any = mesh.vertices.astype(np.float32)
    faces = mesh.faces.astype(np.int32)
    return fast_simplification.simplify(points, faces, target_reduction=1.0 - share)[:2]


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
