"""Mesh files: quick integrity checks, bounds, convex parts kept in a cache keyed by content.

The user's dataset is never written to. What is computed goes to one cache folder
(``HAB_CACHE_DIR``, default ``~/.cache/hab_tasks``).
"""

from __future__ import annotations

import hashlib
import os
import struct
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from trimesh.visual.material import PBRMaterial

from hab_tasks.errors import DatasetError
from hab_tasks.files import written_aside
from hab_tasks.scenes.light_mesh import decimate_textured, fill_background

TEXTURE_SIZE_PX = 512
TEXTURED_TRIANGLES = 1500
"""YCB's scans have 16,384 triangles each, more than a furnished room."""

SINGLE_HULL_EXCESS = 1.15
"""A decomposition whose common hull is at most this much larger than its parts becomes one hull."""


def cache_dir() -> Path:
    """Returns the folder for everything computed from a dataset; made when missing."""
    default = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "hab_tasks"
    folder = Path(os.environ.get("HAB_CACHE_DIR", default))
    folder.mkdir(parents=True, exist_ok=True)
    return folder


@lru_cache(maxsize=1024)
def content_key(file: Path) -> str:
    """Returns a short hash of the file's bytes."""
    return hashlib.sha256(file.read_bytes()).hexdigest()[:20]


def cached_file(name: str, write: Callable[[Path], None]) -> Path:
    """Returns ``cache_dir()/name``; made by `write(path)` when absent, aside, then renamed."""
    path = cache_dir() / name
    if path.exists():
        return path
    with written_aside(path) as scratch:
        write(scratch)
    return path


@lru_cache(maxsize=4096)
def check_mesh(file: Path) -> None:
    """Raises DatasetError when a mesh file is empty or a GLB is cut short."""
    size = file.stat().st_size
    if size == 0:
        raise DatasetError(f"{file}: the file is empty.")
    if file.suffix == ".glb":
        with file.open("rb") as stream:
            header = stream.read(12)
        if len(header) < 12 or header[:4] != b"glTF":
            raise DatasetError(f"{file}: not a GLB file (no glTF header).")
        stated = struct.unpack("<I", header[8:12])[0]
        if stated != size:
            raise DatasetError(f"{file}: truncated, {size} of {stated} bytes. Download it again.")


@lru_cache(maxsize=1024)
def mesh_bounds(file: Path) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Returns (centre, half size) [m] of a mesh file's axis-aligned box in its own frame."""
    low, high = _load_scene(file).bounds
    center, half = (low + high) / 2, (high - low) / 2
    return tuple(map(float, center)), tuple(map(float, half))  # type: ignore[return-value]


def convex_parts(file: Path) -> list[trimesh.Trimesh]:
    """Returns a mesh file's convex parts: one a mesh, or one a connected piece of STL/PLY/OBJ."""
    scene = _load_scene(file)
    pieces: list[trimesh.Trimesh] = []
    meshes: list[Any] = scene.dump()
    for mesh in meshes:
        if file.suffix.lower() in (".stl", ".ply", ".obj"):
            pieces.extend(mesh.split(only_watertight=False))
        else:
            pieces.append(mesh)
    hulls = [piece.convex_hull for piece in pieces if len(piece.vertices) >= 4]
    if not hulls:
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

    path = cached_file(f"parts/{content_key(file)}.glb", write)
    return path, parts_volume(path)


def textured_glb(file: Path) -> Path:
    """Returns a light GLB copy of a textured OBJ: `TEXTURED_TRIANGLES`, `TEXTURE_SIZE_PX`.

    YCB's material files name ``texture_map.jpg`` with a blank behind it, which SAPIEN takes for
    part of the name; and a texture of 4096 pixels for a tin costs more memory than the whole room.
    """

    def write(path: Path) -> None:
        mesh: Any = trimesh.load_mesh(file, process=False)
        material = mesh.visual.material
        image = material.image.convert("RGB")
        image.thumbnail((2 * TEXTURE_SIZE_PX, 2 * TEXTURE_SIZE_PX))
        image = fill_background(image, mesh)
        image.thumbnail((TEXTURE_SIZE_PX, TEXTURE_SIZE_PX))
        mesh.visual.material = PBRMaterial(
            baseColorTexture=image, metallicFactor=0.0, roughnessFactor=0.7
        )
        light = decimate_textured(mesh, TEXTURED_TRIANGLES)
        path.write_bytes(light.export(file_type="glb"))

    key = f"{content_key(file)}-{TEXTURE_SIZE_PX}-{TEXTURED_TRIANGLES}"
    return cached_file(f"visual/{key}.glb", write)


@lru_cache(maxsize=1024)
def parts_volume(file: Path) -> float:
    """Returns the summed volume [m^3] of the convex parts in a mesh file."""
    return float(sum(hull.volume for hull in convex_parts(file)))


def _load_scene(file: Path) -> trimesh.Scene:
    check_mesh(file)
    try:
        scene = trimesh.load_scene(file, skip_materials=True)
    except Exception as error:
        raise DatasetError(f"{file}: cannot be read as a mesh ({error}).") from error
    if scene.is_empty or not np.isfinite(scene.bounds).all():
        raise DatasetError(f"{file}: holds no mesh.")
    return scene
