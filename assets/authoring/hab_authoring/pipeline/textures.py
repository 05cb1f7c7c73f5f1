"""Smaller, GPU-compressed textures (S B.1).

S B.1 compresses textures with Basis. SAPIEN reads Basis' container, KTX2, from GLB files
(``KHR_texture_basisu``), but no encoder can be had as a Python package. So the container is filled
with the GPU's own format, BC1 (BC3 for transparent images), which Pillow encodes: 8 (4) times
smaller than what SAPIEN makes of a PNG, and read without transcoding. Programs that cannot read it
show a small PNG that lies beside it in the file.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from io import BytesIO

from PIL import Image

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
