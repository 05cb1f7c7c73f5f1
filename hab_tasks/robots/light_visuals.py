"""Light visual models of robots for rendering without a GPU.

ManiSkill's Fetch has some 200,000 triangles, which take most of a software renderer's time. Here
each link's mesh is split by colour (its texture sampled at every face), each colour is decimated,
and the result is cached. Collision geometry is unchanged.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import trimesh
from numpy.typing import NDArray
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from hab_tasks.io.cache import cached_file
from hab_tasks.world.scenes.meshes import check_mesh, content_key
from hab_tasks.world.scenes.visuals import simplified

TRIANGLES_PER_LINK = 500
_PALETTE_STEPS = 4
_MIN_SHARE = 0.02
_GREY = np.array([0.6, 0.6, 0.6])


def lighten(root: ElementTree.Element) -> None:
    """Replaces every visual mesh in a URDF tree, with absolute paths, by a decimated copy."""
    for visual in root.iter("visual"):
        mesh = visual.find("geometry/mesh")
        if mesh is None:
            continue
        source = Path(mesh.get("filename", ""))
        color = visual.find("material/color")
        rgba = color.get("rgba", "") if color is not None else ""
        mesh.set("filename", str(light_mesh(source, rgba)))


def light_mesh(source: Path, rgba: str) -> Path:
    """Returns a decimated GLB of `source` with about `TRIANGLES_PER_LINK` triangles at most."""

    def write(path: Path) -> None:
        glb: Any = _reduced(source, rgba).export(file_type="glb")
        path.write_bytes(glb)

    key = f"{content_key(source)}-{TRIANGLES_PER_LINK}-{rgba.replace(' ', '_') or 'texture'}"
    return cached_file(f"light/{source.stem}-{key}.glb", write, check_mesh)


def _reduced(source: Path, rgba: str) -> trimesh.Scene:
    logging.getLogger("trimesh").setLevel(logging.ERROR)
    meshes: list[Any] = trimesh.load_scene(source).dump()
    colors = [_face_colors(mesh, rgba) for mesh in meshes]
    faces_total = sum(len(mesh.faces) for mesh in meshes)
    keep = min(1.0, TRIANGLES_PER_LINK / max(faces_total, 1))
    scene = trimesh.Scene()
    for mesh, face_colors in zip(meshes, colors, strict=True):
        for index, (color, piece) in enumerate(_split_by_color(mesh, face_colors)):
            reduced = _decimate(piece, keep)
            reduced.visual = TextureVisuals(
                material=PBRMaterial(
                    baseColorFactor=[*color, 1.0], metallicFactor=0.0, roughnessFactor=0.6
                )
            )
            scene.add_geometry(reduced, node_name=f"part_{len(scene.geometry)}_{index}")
    return scene


def _face_colors(mesh: trimesh.Trimesh, rgba: str) -> NDArray[np.float64]:
    """Returns (F, 3) colours in [0, 1]: texture at the face's centre, else the plain colour."""
    if rgba:
        return np.tile([float(x) for x in rgba.split()[:3]], (len(mesh.faces), 1))
    visual: Any = mesh.visual
    material = getattr(visual, "material", None)
    image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
    if image is not None and getattr(visual, "uv", None) is not None:
        pixels = np.asarray(image.convert("RGB"), dtype=float) / 255.0
        uv = np.asarray(visual.uv)[mesh.faces].mean(axis=1) % 1.0
        rows = ((1.0 - uv[:, 1]) * (pixels.shape[0] - 1)).astype(int)
        columns = (uv[:, 0] * (pixels.shape[1] - 1)).astype(int)
        return pixels[rows, columns]
    main = getattr(material, "main_color", None)
    color = np.asarray(main[:3], dtype=float) / 255.0 if main is not None else _GREY
    return np.tile(color, (len(mesh.faces), 1))


def _split_by_color(
    mesh: trimesh.Trimesh, colors: NDArray[np.float64]
) -> list[tuple[NDArray[np.float64], trimesh.Trimesh]]:
    """Groups faces by coarse colour; rare colours are merged with the most frequent one."""
    coarse = np.round(colors * (_PALETTE_STEPS - 1)).astype(int)
    _, labels, counts = np.unique(coarse, axis=0, return_inverse=True, return_counts=True)
    labels = labels.reshape(-1)
    rare = counts < _MIN_SHARE * len(labels)
    labels = np.where(rare[labels], int(np.argmax(counts)), labels)
    pieces = []
    for label in np.unique(labels):
        chosen = labels == label
        piece = mesh.submesh([np.flatnonzero(chosen)], append=True)
        pieces.append((colors[chosen].mean(axis=0), piece))
    return pieces


def _decimate(mesh: trimesh.Trimesh, keep: float) -> trimesh.Trimesh:
    plain = trimesh.Trimesh(mesh.vertices, mesh.faces, process=True)
    if keep >= 1.0 or len(plain.faces) < 24:
        return plain
    return trimesh.Trimesh(*simplified(plain, keep), process=False)
