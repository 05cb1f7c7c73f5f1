"""Memory of a visual mesh in SAPIEN, computed from its file."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

from PIL import Image

from hab_authoring.pipeline.glb import Glb, read_glb

VERTEX_BYTES = 56
"""Position, normal, tangent and bitangent of three floats, texture coordinate of two."""

INDEX_BYTES = 4
PIXEL_BYTES = 4
"""Images of any format become RGBA."""

_KTX2_LEVEL_LENGTH_AT = 88


@dataclass(frozen=True, kw_only=True)
class Footprint:
    """Sizes of one or more meshes."""

    triangles: int = 0
    mesh_bytes: int = 0
    texture_bytes: int = 0

    def __add__(self, other: Footprint) -> Footprint:
        """Returns the summed sizes."""
        return Footprint(
            triangles=self.triangles + other.triangles,
            mesh_bytes=self.mesh_bytes + other.mesh_bytes,
            texture_bytes=self.texture_bytes + other.texture_bytes,
        )

    @property
    def total_bytes(self) -> int:
        """Meshes and textures."""
        return self.mesh_bytes + self.texture_bytes


def footprint(files: Iterable[Path]) -> Footprint:
    """Returns the sizes of GLB files, each loaded once.

    Raises:
        DatasetError: A file is damaged.
    """
    return sum(map(_of_file, files), Footprint())


def _of_file(file: Path) -> Footprint:
    glb = read_glb(file)
    document = glb.document
    corners = vertices = 0
    for mesh in document.get("meshes", []):
        for primitive in mesh["primitives"]:
            points = document["accessors"][primitive["attributes"]["POSITION"]]["count"]
            vertices += points
            has_indices = "indices" in primitive
            corners += (
                document["accessors"][primitive["indices"]]["count"] if has_indices else points
            )
    return Footprint(
        triangles=corners // 3,
        mesh_bytes=VERTEX_BYTES * vertices + INDEX_BYTES * corners,
        texture_bytes=sum(_image_bytes(glb, number) for number in _images(document)),
    )


def _images(document: dict[str, Any]) -> set[int]:
    """Returns the numbers of the images that SAPIEN loads."""
    shown = set()
    for texture in document.get("textures", []):
        extension = texture.get("extensions", {}).get("KHR_texture_basisu", {})
        shown.add(extension.get("source", texture.get("source")))
    return shown - {None}


def _image_bytes(glb: Glb, number: int) -> int:
    entry = glb.document["images"][number]
    if "bufferView" not in entry:
        return 0
    content = glb.views[entry["bufferView"]]
    if entry.get("mimeType") == "image/ktx2":
        return struct.unpack_from("<Q", content, _KTX2_LEVEL_LENGTH_AT)[0]
    with Image.open(BytesIO(content)) as image:
        return PIXEL_BYTES * image.width * image.height
