"""Lossless reading and writing of GLB files: the JSON document and its binary views.

Nodes, materials and extensions unknown to the pipeline are preserved.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hab_tasks.errors import DatasetError
from hab_tasks.world.scenes.meshes import COMPONENTS, WIDTHS, check_mesh, glb_document

_UINT16, _UINT32 = 5123, 5125
_ALIGNMENT_BYTES = 16
_JSON, _BINARY = b"JSON", b"BIN\0"


@dataclass(kw_only=True)
class Glb:
    """A GLB file in memory.

    Attributes:
        document: The glTF document.
        views: Contents of `document["bufferViews"]`, in the same order.
    """

    document: dict[str, Any]
    views: list[bytes]

    def is_plain(self, accessor: int) -> bool:
        """Returns whether an accessor's values lie in a view one after the other."""
        entry = self.document["accessors"][accessor]
        if "sparse" in entry or "bufferView" not in entry:
            return False
        view = self.document["bufferViews"][entry["bufferView"]]
        return not view.get("extensions")

    def array(self, accessor: int) -> NDArray[Any]:
        """Returns the values (count, width) of a plain accessor."""
        entry = self.document["accessors"][accessor]
        kind = np.dtype(COMPONENTS[entry["componentType"]])
        width, count = WIDTHS[entry["type"]], entry["count"]
        view = self.document["bufferViews"][entry["bufferView"]]
        stride = view.get("byteStride", width * kind.itemsize)
        return np.ndarray(
            (count, width),
            kind,
            self.views[entry["bufferView"]],
            entry.get("byteOffset", 0),
            (stride, kind.itemsize),
        ).copy()

    def add_vertices(self, values: NDArray[Any], like: int) -> int:
        """Appends values (count, width) of the same kind as accessor `like`; returns the number."""
        old = self.document["accessors"][like]
        entry = {key: old[key] for key in ("componentType", "type", "normalized") if key in old}
        if "min" in old:
            entry |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        return self._add_accessor(entry, values)

    def add_indices(self, faces: NDArray[np.int64]) -> int:
        """Appends triangles (K, 3); returns the number of the accessor."""
        kind = _UINT16 if faces.max(initial=0) < 2**16 - 1 else _UINT32
        values = faces.reshape(-1, 1).astype(COMPONENTS[kind])
        return self._add_accessor({"componentType": kind, "type": "SCALAR"}, values)

    def add_view(self, content: bytes) -> int:
        """Appends a view; returns its number."""
        self.document["bufferViews"].append({"buffer": 0})
        self.views.append(content)
        return len(self.views) - 1

    def write(self, path: Path) -> None:
        """Writes the file, without unreferenced views."""
        self._drop_unused()
        body = bytearray()
        for view, content in zip(self.document["bufferViews"], self.views, strict=True):
            body += bytes(-len(body) % _ALIGNMENT_BYTES)
            view |= {"byteOffset": len(body), "byteLength": len(content)}
            body += content
        body += bytes(-len(body) % 4)
        self.document["buffers"] = [{"byteLength": len(body)}]
        text = json.dumps(self.document, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = b"".join(
            struct.pack("<I4s", len(content), kind) + content
            for kind, content in ((_JSON, text), (_BINARY, bytes(body)))
        )
        path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)

    def _add_accessor(self, entry: dict[str, Any], values: NDArray[Any]) -> int:
        # Rows of each view start at multiples of four bytes, which the format asks for.
        stride = values.shape[1] * values.itemsize
        padding = np.zeros((len(values), -stride % 4), np.uint8) if values.shape[1] > 1 else None
        rows = np.ascontiguousarray(values).view(np.uint8).reshape(len(values), stride)
        rows = rows if padding is None else np.hstack((rows, padding))
        view = self.add_view(rows.tobytes())
        if padding is not None and padding.shape[1]:
            self.document["bufferViews"][view]["byteStride"] = rows.shape[1]
        self.document["accessors"].append({"bufferView": view, "count": len(values)} | entry)
        return len(self.document["accessors"]) - 1

    def _drop_unused(self) -> None:
        document = self.document
        users = _accessor_users(document)
        _renumber(document, "accessors", users)
        holders = [*document.get("accessors", []), *document.get("images", [])]
        for accessor in document.get("accessors", []):
            holders.extend(accessor.get("sparse", {}).get(k, {}) for k in ("indices", "values"))
        for mesh in document.get("meshes", []):
            holders.extend(e for p in mesh["primitives"] for e in p.get("extensions", {}).values())
        users = [(holder, "bufferView") for holder in holders if "bufferView" in holder]
        kept = _renumber(document, "bufferViews", users)
        self.views = [self.views[index] for index in kept]


def read_glb(file: Path) -> Glb:
    """Reads a GLB file.

    Raises:
        DatasetError: It is damaged, or keeps its geometry in other files.
    """
    check_mesh(file)
    data = file.read_bytes()
    try:
        document, start = glb_document(file, data)
        body = data[start:]
        views = [_content(file, view, body) for view in document.setdefault("bufferViews", [])]
        if any("uri" in buffer for buffer in document.get("buffers", [])):
            raise DatasetError(f"{file}: its geometry lies in another file; one GLB is needed.")
    except (struct.error, ValueError, KeyError, TypeError) as error:
        raise DatasetError(f"{file}: not a readable GLB ({error}).") from error
    return Glb(document=document, views=views)


def _content(file: Path, view: dict[str, Any], body: bytes) -> bytes:
    start = view.get("byteOffset", 0)
    content = body[start : start + view["byteLength"]]
    if len(content) != view["byteLength"]:
        raise DatasetError(f"{file}: a buffer view reaches beyond the end of the file.")
    return content


def _accessor_users(document: dict[str, Any]) -> list[tuple[dict[str, Any], str]]:
    users: list[tuple[dict[str, Any], str]] = []
    for mesh in document.get("meshes", []):
        for primitive in mesh["primitives"]:
            users.extend((primitive["attributes"], name) for name in primitive["attributes"])
            users.extend(
                (target, name) for target in primitive.get("targets", []) for name in target
            )
            users.extend([(primitive, "indices")] if "indices" in primitive else [])
    for animation in document.get("animations", []):
        users.extend((s, name) for s in animation["samplers"] for name in ("input", "output"))
    skins = document.get("skins", [])
    users.extend((s, "inverseBindMatrices") for s in skins if "inverseBindMatrices" in s)
    return users


def _renumber(
    document: dict[str, Any], kind: str, users: list[tuple[dict[str, Any], str]]
) -> list[int]:
    """Keeps only the entries of a list that are referred to; returns their old numbers."""
    kept = sorted({holder[name] for holder, name in users})
    number = {old: new for new, old in enumerate(kept)}
    for holder, name in users:
        holder[name] = number[holder[name]]
    if kind in document:
        document[kind] = [document[kind][index] for index in kept]
    return kept
