"""Wire formats of policy servers: openpi and vla-eval.

Both are msgpack over WebSocket, with arrays as maps of bytes, dtype and shape. Only arrays of
booleans and real numbers are decoded, and messages have a maximum size.
"""

from __future__ import annotations

import io
import math
import time
from collections.abc import Mapping
from typing import Any, Literal, get_args

import msgpack
import numpy as np

from hab_eval.errors import AgentError
from hab_tasks.errors import shown

Protocol = Literal["openpi", "vla-eval"]
PROTOCOLS: tuple[str, ...] = get_args(Protocol)

ImageFormat = Literal["raw", "png"]
IMAGE_FORMATS: tuple[str, ...] = get_args(ImageFormat)

MOST_BYTES = 64 * 2**20
"""Maximum size of a message; two colour and depth images of 1024 pixels have 15 MiB."""

MOST_PIXELS = 4096 * 4096
MOST_DIMENSIONS = 8
NUMBERS = "biuf"
"""Kinds of valid dtypes: booleans, integers, floats."""

ARRAY, SCALAR, IMAGE = "__ndarray__", "__npgeneric__", "__image__"
MARKS = (ARRAY, ARRAY.encode(), SCALAR, SCALAR.encode(), IMAGE)
"""Keys that mark a map as an array, a number or an image; openpi's are bytes."""

TOKEN_VARIABLE = "HAB_REMOTE_TOKEN"  # the name of the variable, not the token
"""Environment variable with the token of a server."""


class RemoteError(AgentError):
    """A policy server that cannot be reached, or a message that violates the protocol."""


def pack(value: Any, protocol: str, images: str = "raw") -> bytes:
    """Returns a message; with `images` ``png``, vla-eval's uint8 images are compressed."""

    def encoded(item: Any) -> Any:
        if isinstance(item, np.generic):
            return item.item()
        if not isinstance(item, np.ndarray) or item.dtype.kind not in NUMBERS:
            raise TypeError(f"{type(item).__name__} cannot be sent")
        if images == "png" and item.dtype == np.uint8 and item.ndim == 3:
            return _png(item)
        return _array_map(item, protocol)

    packed = msgpack.packb(value, default=encoded)
    assert packed is not None
    return packed


def unpack(message: str | bytes) -> Any:
    """Returns the content of a message of either protocol.

    Raises:
        RemoteError: It is not msgpack, or contains an invalid array.
    """
    try:
        if isinstance(message, str):
            raise TypeError("text instead of msgpack")
        return msgpack.unpackb(message, object_hook=_decoded)
    except RemoteError:
        raise
    except Exception as error:  # msgpack raises errors of many classes
        raise RemoteError(
            f"A message cannot be decoded: {error or type(error).__name__}."
        ) from error


def event(kind: str, payload: Mapping[str, Any], seq: int) -> dict[str, Any]:
    """Returns a message of vla-eval."""
    return {"type": kind, "payload": payload, "seq": seq, "timestamp": time.time()}


def read_event(message: str | bytes) -> tuple[str, dict[str, Any], int]:
    """Returns type, payload and number of a message of vla-eval.

    Raises:
        RemoteError: It is none.
    """
    found = unpack(message)
    if isinstance(found, dict):
        kind, payload, seq = (found.get(name) for name in ("type", "payload", "seq"))
        if isinstance(kind, str) and isinstance(payload, dict) and isinstance(seq, int):
            return kind, payload, seq
    raise RemoteError("A message has no type, payload and seq; is the protocol vla-eval?")


def _array_map(array: np.ndarray, protocol: str) -> dict[Any, Any]:
    found: dict[str, Any] = {ARRAY: True, "data": array.tobytes(), "dtype": array.dtype.str}
    found["shape"] = list(array.shape)
    return {key.encode(): value for key, value in found.items()} if protocol == "openpi" else found


def _png(image: np.ndarray) -> dict[str, Any]:
    from PIL import Image

    file = io.BytesIO()
    flat = image[:, :, 0] if image.shape[2] == 1 else image
    Image.fromarray(flat).save(file, format="PNG", compress_level=1)
    return {IMAGE: True, "format": "png", "data": file.getvalue(), "shape": list(image.shape)}


def _decoded(found: dict[Any, Any]) -> Any:
    """Returns the array, number or image that a map describes; other maps as they are."""
    if not any(mark in found for mark in MARKS):
        return found
    fields = {k.decode() if isinstance(k, bytes) else k: value for k, value in found.items()}
    data = fields.get("data")
    if IMAGE in fields and fields.get("format") != "raw":
        return _image(data, fields.get("format"), _shape(fields.get("shape")))
    dtype = _dtype(fields.get("dtype"))
    if SCALAR in fields:
        if not isinstance(data, bool | int | float):
            raise RemoteError(f"A number is {shown(data)}.")
        return dtype.type(data)
    shape = _shape(fields.get("shape"))
    size = math.prod(shape) * dtype.itemsize
    if not isinstance(data, bytes) or len(data) != size:
        there = len(data) if isinstance(data, bytes) else "no"
        raise RemoteError(f"An array {dtype} {list(shape)} has {there} bytes, not {size}.")
    # A copy, because the message's bytes are read-only; in this machine's byte order.
    return np.frombuffer(data, dtype).reshape(shape).astype(dtype.newbyteorder("="))


def _dtype(name: Any) -> np.dtype[Any]:
    """Returns a dtype of numbers; structures and objects are invalid."""
    if isinstance(name, str) and len(name) <= 8:
        try:
            dtype = np.dtype(name)
        except (TypeError, ValueError, SyntaxError):
            dtype = np.dtype("V1")
        if dtype.kind in NUMBERS and dtype.itemsize <= 8:
            return dtype
    raise RemoteError(f"An array has dtype {shown(name)}; valid: bool, integers and floats.")


def _shape(shape: Any) -> tuple[int, ...]:
    whole = isinstance(shape, list | tuple) and len(shape) <= MOST_DIMENSIONS
    if whole and all(type(size) is int and 0 <= size <= MOST_BYTES for size in shape):
        return tuple(shape)
    raise RemoteError(f"An array has shape {shown(shape)}; valid: up to 8 sizes.")


def _image(data: Any, form: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Returns a PNG image (H, W, C)."""
    from PIL import Image

    if form != "png" or not isinstance(data, bytes):
        raise RemoteError(f"An image has format {shown(form)}; valid: {', '.join(IMAGE_FORMATS)}.")
    with Image.open(io.BytesIO(data), formats=["PNG"]) as file:
        if file.width * file.height > MOST_PIXELS:
            raise RemoteError(f"An image has {file.width} x {file.height} pixels; too many.")
        image = np.array(file)
    image = image[:, :, None] if image.ndim == 2 else image
    if image.dtype != np.uint8 or image.shape != shape:
        raise RemoteError(f"An image has shape {list(image.shape)}, not {list(shape)}.")
    return image
