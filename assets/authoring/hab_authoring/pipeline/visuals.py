"""Lighter copies of visual meshes: fewer triangles, smaller and compressed textures (S B.1).

S B.1 compresses textures with Basis. SAPIEN reads Basis' container, KTX2, from GLB files
(``KHR_texture_basisu``), but no encoder can be had as a Python package. So the container is filled
with the GPU's own format, BC1 (BC3 for transparent images), which Pillow encodes: 8 (4) times
smaller than what SAPIEN makes of a PNG, and read without transcoding. Programs that cannot read it
show a small PNG that lies beside it in the file.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from PIL import Image, UnidentifiedImageError
from trimesh.visual import TextureVisuals
from trimesh.visual.material import SimpleMaterial

from hab_authoring.pipeline.decimate import Surface, Thinned, face_normals, thin
from hab_authoring.pipeline.glb import Glb, read_glb
from hab_authoring.pipeline.jobs import AssetOptions
from hab_tasks.errors import DatasetError
from hab_tasks.world.scenes.visuals import fill_background

FALLBACK_PX = 64
"""Size of the PNG for programs that cannot read compressed textures."""

_EXTENSION = "KHR_texture_basisu"
_TRIANGLES = 4
_JPEG_QUALITY = 92


def write_light_glb(source: Path, options: AssetOptions, path: Path) -> None:
    """Writes a light copy of a GLB.

    Raises:
        DatasetError: `source` is damaged.
    """
    glb = read_glb(source)
    for mesh in glb.document.get("meshes", []):
        _thin_mesh(glb, mesh, options.decimate)
    colored = _color_images(glb.document)
    for number, entry in enumerate(list(glb.document.get("images", []))):
        # An image in a file of its own stays there.
        if "bufferView" in entry and entry.get("mimeType") != "image/ktx2":
            _lighten_image(glb, source, number, number in colored, options)
    glb.write(path)


def write_light_obj(source: Path, texture: Path, options: AssetOptions, path: Path) -> None:
    """Writes a folder with a light copy of a textured OBJ: the OBJ, its material, its image.

    All three keep their names. The image keeps its format, too: an OBJ has no other container.

    Args:
        source: The OBJ.
        texture: Its only image, from `texture_file`.
        options: How light.
        path: The folder.

    Raises:
        DatasetError: `source` is damaged or has no texture coordinates.
    """
    mesh: Any = trimesh.load_mesh(source, process=False)
    uv = getattr(mesh.visual, "uv", None)
    if uv is None:
        raise DatasetError(f"{source}: it has no texture coordinates.")
    points, faces = np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces, dtype=np.int64)
    thinned = thin(Surface(points=points, faces=faces, uv=uv, normals=None), options.decimate)
    pairs = np.column_stack((thinned.position.reshape(-1), thinned.attribute.reshape(-1)))
    vertices, corner = np.unique(pairs, axis=0, return_inverse=True)
    light = trimesh.Trimesh(points[vertices[:, 0]], corner.reshape(-1, 3), process=False)
    light.visual = TextureVisuals(uv=uv[vertices[:, 1]], material=SimpleMaterial())
    text: Any = light.export(file_type="obj", include_normals=False, write_texture=False)
    text = re.sub(r"(?m)^(mtllib|usemtl) .*\n", "", text)
    name = source.stem
    path.mkdir()
    (path / f"{name}.obj").write_text(f"mtllib {name}.mtl\nusemtl {name}\n{text}\n")
    (path / f"{name}.mtl").write_text(f"newmtl {name}\nKd 1 1 1\nmap_Kd {texture.name}\n")
    with Image.open(texture) as image:
        # Scans are black between the pieces of their texture, and smaller images mix it in.
        filled = fill_background(shrink(image.convert("RGB"), 2 * options.texture_px), mesh)
    shrink(filled, options.texture_px).save(path / texture.name, quality=_JPEG_QUALITY)


def texture_file(source: Path) -> Path:
    """Returns the image of an OBJ's material.

    Raises:
        DatasetError: It names none, or one that is absent.
    """
    material = source.with_suffix(".mtl")
    text = material.read_text() if material.exists() else ""
    names = re.findall(r"(?m)^\s*map_Kd\s+(\S+)\s*$", text)
    if not names or not source.with_name(names[0]).exists():
        raise DatasetError(f"{material}: names no image beside it (map_Kd).")
    return source.with_name(names[0])


def _thin_mesh(glb: Glb, mesh: dict[str, Any], fraction: float) -> None:
    """Thins all triangle lists of a mesh together, so that no crack opens between materials."""
    primitives = [p for p in mesh["primitives"] if _can_be_thinned(glb, p)]
    if not primitives:
        return
    parts = [glb.array(p["indices"]).reshape(-1, 3).astype(np.int64) for p in primitives]
    counts = [glb.document["accessors"][p["attributes"]["POSITION"]]["count"] for p in primitives]
    starts = np.cumsum([0, *counts[:-1]])
    points = _joined(glb, primitives, "POSITION")
    assert points is not None
    surface = Surface(
        points=points,
        faces=np.concatenate([part + start for part, start in zip(parts, starts, strict=True)]),
        uv=_joined(glb, primitives, "TEXCOORD_0"),
        normals=_joined(glb, primitives, "NORMAL"),
    )
    thinned = thin(surface, fraction)
    owner = np.repeat(np.arange(len(parts)), [len(part) for part in parts])[thinned.faces]
    if len(owner) == len(surface.faces):
        return
    for number, primitive in enumerate(primitives):
        _replace(glb, primitive, surface, thinned, owner == number, int(starts[number]))
    mesh["primitives"] = [p for p in mesh["primitives"] if "indices" not in p or _count(glb, p)]


def _joined(glb: Glb, primitives: list[dict[str, Any]], name: str) -> Any:
    """Returns one attribute of all primitives, one below the other; None where one lacks it."""
    if any(name not in p["attributes"] for p in primitives):
        return None
    return np.concatenate([glb.array(p["attributes"][name]) for p in primitives]).astype(float)


def _replace(
    glb: Glb, primitive: dict[str, Any], surface: Surface, thinned: Thinned, own: Any, start: int
) -> None:
    """Gives a primitive its thinned triangles.

    Args:
        glb: The file.
        primitive: Changed in place.
        surface: The whole mesh.
        thinned: What is left of it.
        own: (K,) which of its triangles are this primitive's.
        start: Number of the primitive's first vertex among the mesh's.
    """
    position, attribute = thinned.position[own], thinned.attribute[own]
    triangle = 1 + np.arange(len(position))[:, None]
    rows = (position, attribute, np.where(thinned.flat[own], triangle, 0))
    vertices, corner = np.unique(
        np.column_stack([row.reshape(-1) for row in rows]), axis=0, return_inverse=True
    )
    flat = vertices[:, 2] > 0
    for name, accessor in list(primitive["attributes"].items()):
        values = glb.array(accessor)[vertices[:, 1] - start]
        if name == "POSITION":
            values = surface.points[vertices[:, 0]].astype(values.dtype)
        if name == "NORMAL":
            values[flat] = face_normals(surface.points, position)[vertices[flat, 2] - 1]
        primitive["attributes"][name] = glb.add_vertices(values, accessor)
    primitive["indices"] = glb.add_indices(corner.reshape(-1, 3))


def _can_be_thinned(glb: Glb, primitive: dict[str, Any]) -> bool:
    if primitive.get("mode", _TRIANGLES) != _TRIANGLES or "indices" not in primitive:
        return False
    if primitive.get("targets") or primitive.get("extensions"):
        return False
    return all(map(glb.is_plain, [primitive["indices"], *primitive["attributes"].values()]))


def _count(glb: Glb, primitive: dict[str, Any]) -> int:
    return glb.document["accessors"][primitive["indices"]]["count"]


def _color_images(document: dict[str, Any]) -> set[int]:
    """Returns the numbers of the images that are colours and nothing else, and not compressed."""
    colors, others = set(), set()
    for material in document.get("materials", []):
        surface = material.get("pbrMetallicRoughness", {})
        for name, entry in (*surface.items(), *material.items()):
            if name.endswith("Texture"):
                texture = document["textures"][entry["index"]]
                is_color = name in ("baseColorTexture", "emissiveTexture")
                is_compressed = _EXTENSION in texture.get("extensions", {})
                (colors if is_color and not is_compressed else others).add(texture.get("source"))
    return colors - others - {None}


def _lighten_image(
    glb: Glb, source: Path, number: int, is_color: bool, options: AssetOptions
) -> None:
    entry = glb.document["images"][number]
    try:
        image = Image.open(BytesIO(glb.views[entry["bufferView"]]))
        image.load()
    except (UnidentifiedImageError, OSError, SyntaxError) as error:
        raise DatasetError(f"{source}: its texture {number} cannot be read ({error}).") from error
    if is_color:
        image = image.convert("RGBA" if image.has_transparency_data else "RGB")
    small = shrink(image, options.texture_px)
    if options.texture_format == "png" or not is_color:
        if small.size != image.size:
            entry |= {"bufferView": glb.add_view(png(small)), "mimeType": "image/png"}
        return
    document = glb.document
    fallback = png(shrink(image, FALLBACK_PX))
    entry |= {"bufferView": glb.add_view(fallback), "mimeType": "image/png"}
    document["images"].append({"bufferView": glb.add_view(ktx2(small)), "mimeType": "image/ktx2"})
    extension = {_EXTENSION: {"source": len(document["images"]) - 1}}
    for texture in document["textures"]:
        if texture.get("source") == number:
            texture["extensions"] = texture.get("extensions", {}) | extension
    document["extensionsUsed"] = sorted({*document.get("extensionsUsed", []), _EXTENSION})


_IDENTIFIER = b"\xabKTX 20\xbb\r\n\x1a\n"
_INDEX_END_BYTES = 104
_DDS_HEADER_BYTES = 128
_BLOCK_PX = 4


@dataclass(frozen=True, kw_only=True)
class _Format:
    """A block format: names and numbers of Pillow, Vulkan and the Khronos data format.

    Attributes:
        samples: (bit offset, channel) of each part of a block.
    """

    pillow: str
    vulkan: int
    model: int
    block_bytes: int
    samples: tuple[tuple[int, int], ...]


_BC1 = _Format(pillow="DXT1", vulkan=132, model=128, block_bytes=8, samples=((0, 0),))
_BC3 = _Format(pillow="DXT5", vulkan=138, model=130, block_bytes=16, samples=((0, 15), (64, 0)))
_SRGB, _BT709, _VERSION = 2, 1, 2


def shrink(image: Image.Image, size_px: int) -> Image.Image:
    """Returns a copy at most `size_px` wide and high."""
    small = image.copy()
    small.thumbnail((size_px, size_px), Image.Resampling.LANCZOS)
    return small


def png(image: Image.Image) -> bytes:
    """Returns the image as a PNG file."""
    stream = BytesIO()
    image.save(stream, "PNG", optimize=True)
    return stream.getvalue()


def ktx2(image: Image.Image) -> bytes:
    """Returns a colour image as a KTX2 file in BC1 or BC3, in whole blocks.

    It has one mip level, as SAPIEN gives to every PNG: smaller levels would mix the charts of a
    texture, which then show at the edges of things.
    """
    rgba = image.convert("RGBA")
    kind = _BC1 if rgba.getchannel("A").getextrema() == (255, 255) else _BC3
    size = (_in_blocks(rgba.width), _in_blocks(rgba.height))
    stream = BytesIO()
    (rgba if rgba.size == size else rgba.resize(size)).save(stream, "DDS", pixel_format=kind.pillow)
    blocks = stream.getvalue()[_DDS_HEADER_BYTES:]
    description = _description(kind)
    start = _INDEX_END_BYTES + len(description)
    start += -start % kind.block_bytes
    header = struct.pack("<9I", kind.vulkan, 1, *size, 0, 0, 1, 1, 0)
    header += struct.pack("<4I2Q", _INDEX_END_BYTES, len(description), 0, 0, 0, 0)
    index = struct.pack("<3Q", start, len(blocks), len(blocks))
    return (_IDENTIFIER + header + index + description).ljust(start, b"\0") + blocks


def _in_blocks(size_px: int) -> int:
    """Returns the size rounded up to whole blocks."""
    return -(-size_px // _BLOCK_PX) * _BLOCK_PX


def _description(kind: _Format) -> bytes:
    """Returns the Khronos data format descriptor of a block format."""
    samples = b"".join(
        struct.pack("<HBB4BII", offset, 63, channel, 0, 0, 0, 0, 0, 2**32 - 1)
        for offset, channel in kind.samples
    )
    size = 24 + len(samples)
    sides = (_BLOCK_PX - 1, _BLOCK_PX - 1, 0, 0)
    planes = (kind.block_bytes, *[0] * 7)
    block = struct.pack("<IHH4B", 0, _VERSION, size, kind.model, _BT709, _SRGB, 0)
    return struct.pack("<I", 4 + size) + block + struct.pack("<12B", *sides, *planes) + samples
