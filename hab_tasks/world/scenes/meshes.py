"""Mesh files: validation, bounds and convex parts, kept in the cache by content.

The user's dataset is never written to. The engine only logs unreadable meshes and continues with a
body without collisions, so every buffer, accessor, node and vertex of a GLB is checked first. It is
mapped into memory, and only its document, vertices and indices are read: a few milliseconds.
"""

from __future__ import annotations

import hashlib
import json
import mmap
import struct
from collections.abc import Callable
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import QhullError

from hab_tasks.errors import DatasetError
from hab_tasks.io.cache import cached
from hab_tasks.world.scenes.fields import check_file, read_bytes

SINGLE_HULL_EXCESS = 1.15
"""A decomposition whose common hull is at most this much larger than its parts becomes one hull."""

COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
"""glTF component type -> numpy dtype."""

WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
"""glTF element type -> number of components."""

POSE = {"matrix": 16, "translation": 3, "rotation": 4, "scale": 3}
"""Pose entry of a node -> number of values."""

LARGEST_M = 1e4
"""Maximum distance of a vertex to the mesh's origin."""

_HEADER_BYTES, _CHUNK_BYTES = 12, 8
_JSON, _BINARY = b"JSON", b"BIN\0"
_TRIANGLES = 4
_MALFORMED = (struct.error, ValueError, LookupError, TypeError, AttributeError, OverflowError)
"""Exceptions raised on using values of the wrong type."""


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


@lru_cache(maxsize=1024)
def parts_volume(file: Path) -> float:
    """Returns the summed volume [m^3] of the convex parts in a mesh file."""
    return float(sum(hull.volume for hull in convex_parts(file)))


@lru_cache(maxsize=1024)
def smallest_side_m(file: Path) -> float:
    """Returns the smallest side of the box around the convex parts in a mesh file."""
    corners = np.concatenate([hull.bounds for hull in convex_parts(file)])
    return float((corners.max(axis=0) - corners.min(axis=0)).min())


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
    return loaded_mesh(file, partial(trimesh.load_scene, **options))


def loaded_mesh(file: Path, load: Callable[[Path], Any]) -> Any:
    """Returns what one of trimesh's readers makes of a file; raises as `read_mesh` does."""
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


@lru_cache(maxsize=4096)
def check_mesh(file: Path) -> None:
    """Raises DatasetError when a mesh file is absent or empty, or a GLB cannot be read."""
    size = check_file(file)
    if size == 0:
        raise DatasetError(f"{file}: the file is empty.")
    if file.suffix.lower() != ".glb":
        return
    with file.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
        try:
            _check_glb(file, data)
        except _MALFORMED as error:
            raise DatasetError(f"{file}: damaged ({type(error).__name__}: {error}).") from error
        except RecursionError as error:
            raise DatasetError(f"{file}: damaged (its document is nested too deep).") from error


def _check_glb(file: Path, data: mmap.mmap) -> None:
    document, start = glb_document(file, data)
    holder = _Accessors(document, data, start)
    corners = 0
    for mesh in document.get("meshes", []):
        corners += sum(_check_primitive(holder, primitive) for primitive in mesh["primitives"])
    if corners < 3:
        raise DatasetError(f"{file}: holds no mesh.")
    _check_nodes(document)


def glb_document(file: Path, data: mmap.mmap | bytes) -> tuple[dict[str, Any], int]:
    """Returns the document of a GLB and where its binary buffer starts."""
    if len(data) < _HEADER_BYTES or data[:4] != b"glTF":
        raise DatasetError(f"{file}: not a GLB file (no glTF header).")
    version, stated = struct.unpack_from("<II", data, 4)
    if stated != len(data):
        words = f"truncated, {len(data)} of {stated} bytes"
        raise DatasetError(f"{file}: {words}. Download it again.")
    length, kind = struct.unpack_from("<I4s", data, _HEADER_BYTES)
    end = _HEADER_BYTES + _CHUNK_BYTES + length
    if version != 2 or kind != _JSON or end > len(data):
        raise ValueError("no glTF 2 document at its start")
    document = json.loads(data[_HEADER_BYTES + _CHUNK_BYTES : end])
    if not isinstance(document, dict):
        raise TypeError("its document is no JSON object")
    if end + _CHUNK_BYTES <= len(data):
        length, kind = struct.unpack_from("<I4s", data, end)
        if kind != _BINARY or end + _CHUNK_BYTES + length > len(data):
            raise ValueError("its binary buffer is cut short")
    return document, end + _CHUNK_BYTES


class _Accessors:
    """The arrays in a GLB."""

    def __init__(self, document: dict[str, Any], data: mmap.mmap, start: int) -> None:
        """Checks that every buffer view lies in its buffer."""
        self._document, self._data, self._start = document, data, start
        for number, view in enumerate(document.get("bufferViews", [])):
            buffer = _entry(document, "buffers", view["buffer"])
            first, length = view.get("byteOffset", 0), view["byteLength"]
            own = len(data) - start if "uri" not in buffer else length + first
            if first < 0 or length < 1 or first + length > min(buffer["byteLength"], own):
                raise ValueError(f"buffer view {number} reaches beyond its buffer")

    def array(self, number: int) -> NDArray[Any] | None:
        """Returns values (count, width); None for those that lie compressed or in other files."""
        entry, kind, width, stride = self.check(number)
        if "sparse" in entry or "bufferView" not in entry:
            return None
        view = self._document["bufferViews"][entry["bufferView"]]
        if view.get("extensions") or "uri" in self._document["buffers"][view["buffer"]]:
            return None
        # A copy, as the map cannot be closed under an array that looks into it.
        return np.ndarray(
            (entry["count"], width),
            kind,
            self._data,  # type: ignore[arg-type]
            self._start + view.get("byteOffset", 0) + entry.get("byteOffset", 0),
            (stride, kind.itemsize),
        ).copy()

    def check(self, number: int) -> tuple[dict[str, Any], np.dtype[Any], int, int]:
        """Returns an accessor, the kind and number of its components, and its stride [bytes]."""
        entry = _entry(self._document, "accessors", number)
        kind, width = np.dtype(COMPONENTS[entry["componentType"]]), WIDTHS[entry["type"]]
        count, stride = entry["count"], width * kind.itemsize
        if not isinstance(count, int) or count < 1:
            raise ValueError(f"accessor {number} has a count of {count!r}")
        if "bufferView" in entry:
            view = _entry(self._document, "bufferViews", entry["bufferView"])
            stride = view.get("byteStride") or stride
            at = entry.get("byteOffset", 0)
            needed = at + stride * (count - 1) + width * kind.itemsize
            if (min(at, stride) < 0 or needed > view["byteLength"]) and not view.get("extensions"):
                raise ValueError(f"accessor {number} reaches beyond its buffer view")
        return entry, kind, width, stride


def _check_primitive(accessors: _Accessors, primitive: dict[str, Any]) -> int:
    """Checks corners and indices of one part of a mesh; returns its number of corners."""
    attributes = primitive["attributes"]
    positions = accessors.array(attributes["POSITION"])
    for name in sorted(set(attributes) - {"POSITION"}):
        accessors.check(attributes[name])
    indices = accessors.array(primitive["indices"]) if "indices" in primitive else None
    if positions is None:
        return 3
    if positions.shape[1] != 3:
        raise ValueError("its corners do not have 3 coordinates")
    if (
        positions.dtype.kind == "f"
        and not -LARGEST_M <= positions.min() <= positions.max() <= LARGEST_M
    ):
        raise ValueError(f"a corner is not finite or farther than {LARGEST_M:g} m from the origin")
    if indices is None:
        return len(positions)
    if int(indices.max()) >= len(positions):
        raise ValueError(f"index {indices.max()} of a corner, and there are {len(positions)}")
    if primitive.get("mode", _TRIANGLES) == _TRIANGLES and len(indices) % 3:
        raise ValueError(f"{len(indices)} indices make no triangles")
    return len(positions)


def _check_nodes(document: dict[str, Any]) -> None:
    """Raises ValueError for nodes that hold one another, name what is absent or are not finite."""
    nodes = document.get("nodes", [])
    for scene in document.get("scenes", []):
        for number in scene.get("nodes", []):
            _entry(document, "nodes", number)
    parents: dict[int, int] = {}
    for number, node in enumerate(nodes):
        for child in node.get("children", []):
            _entry(document, "nodes", child)
            if child in parents:
                raise ValueError(f"node {child} is in two others")
            parents[child] = number
        if "mesh" in node:
            _entry(document, "meshes", node["mesh"])
        for name in POSE.keys() & node.keys():
            if len(node[name]) != POSE[name] or not all(abs(v) <= LARGEST_M for v in node[name]):
                raise ValueError(f"nodes[{number}].{name} is not {POSE[name]} finite numbers")
    reached = [number for number in range(len(nodes)) if number not in parents]
    for number in reached:
        reached.extend(nodes[number].get("children", []))
    if len(reached) < len(nodes):
        raise ValueError("nodes hold one another")


def _entry(document: dict[str, Any], kind: str, number: Any) -> dict[str, Any]:
    """Returns an entry of one of the document's lists."""
    entries = document.get(kind, [])
    if not isinstance(number, int) or not 0 <= number < len(entries):
        raise ValueError(f"{kind}[{number!r}] is named, and there are {len(entries)}")
    return entries[number]
