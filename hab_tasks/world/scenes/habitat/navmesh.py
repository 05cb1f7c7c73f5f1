"""Habitat's ``.navmesh`` files (Recast/Detour): the walkable polygons of a scene, y-up, metres.

A file holds one tile: corners, convex polygons with their neighbours, and a finer mesh of
triangles that gives the height inside each polygon. Recast rasterises the scene in
cells, takes off the agent's radius, drops regions below 1 m^2 and simplifies the outlines, so
an edge is good to about a cell, and a height to `cell_height_m`. The bounds in it are those of the
stage mesh, whose substitute `shell` is; `hab_tasks.world.scenes.walls` computes the inner walls.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from hab_tasks.errors import DatasetError
from hab_tasks.geometry import Array
from hab_tasks.world.scenes.fields import LARGEST, read_bytes, refused
from hab_tasks.world.scenes.spec import CollisionSource, Vector

_TILE = b"VAND"
_SETTINGS_AT = 40
_HEADER_BYTES = 100
_LINK_BYTES = 12
_POLYGON = np.dtype("<u4, (6,)<u2, (6,)<u2, <u2, u1, u1")
_POLYGON.names = ("link", "corners", "neighbours", "flags", "count", "area")
_DETAIL = np.dtype("<u4, <u4, u1, u1, <u2")
_DETAIL.names = ("corner_at", "triangle_at", "corners", "triangles", "pad")


@dataclass(frozen=True, kw_only=True)
class NavmeshBounds:
    """The y-up box [m] of the geometry that a navmesh was built from."""

    low: Vector
    high: Vector


@dataclass(frozen=True, kw_only=True, eq=False)
class Navmesh:
    """Walkable area of an agent's centre.

    Attributes:
        bounds: Bounding box of its source geometry.
        cell_height_m: Resolution of heights.
        agent_radius_m: Radius by which obstacles were inflated.
        agent_height_m: Required free height.
        triangles_m: (T, 3, 3) triangles with heights inside the polygons.
    """

    bounds: NavmeshBounds
    cell_height_m: float
    agent_radius_m: float
    agent_height_m: float
    triangles_m: Array

    def heights(self, origin_m: Array, shape: tuple[int, int], cell_m: float) -> Array:
        """Rasterises the walkable surface in cells along x and z; (0, 0) has its middle there.

        Returns:
            Height y [m] at the middle of each cell (X, Z), NaN where nothing is walkable; the
            lowest one where surfaces lie above one another.
        """
        grid = np.full(shape, np.inf)
        for triangle in self.triangles_m:
            _draw(grid, (triangle - [origin_m[0], 0, origin_m[1]]) / [cell_m, 1, cell_m])
        return np.where(np.isfinite(grid), grid, np.nan)


def read_navmesh_bounds(file: Path) -> NavmeshBounds:
    """Reads only the bounds in a ``.navmesh`` file.

    Raises:
        DatasetError: The file holds no Detour tile.
    """
    return _bounds(file, *_tile(file))


@lru_cache(maxsize=256)
def read_navmesh(file: Path) -> Navmesh:
    """Reads a ``.navmesh`` file.

    Raises:
        DatasetError: It holds no Detour tile or more than one, or is cut short.
    """
    data, at = _tile(file)
    bounds = _bounds(file, data, at)
    if data.count(_TILE) > 1 or data[4:8] != b"\x02\0\0\0":
        raise DatasetError(f"{file}: not a navmesh of version 2 with one tile, as Habitat writes.")
    # cell, cell height, agent height, agent radius, climb, slope, ...
    cell, cell_height = struct.unpack_from("<2f", data, _SETTINGS_AT)
    height, radius, climb = struct.unpack_from("<3f", data, at + 60)
    sizes_m = (cell, cell_height, height, radius, climb)
    if not all(0 <= size <= LARGEST for size in sizes_m) or not min(sizes_m[:3]) > 0:
        raise refused(file, "its cell and agent sizes", sizes_m, "numbers above 0")
    try:
        triangles = _read_tile(data, at)
    except (ValueError, IndexError, struct.error, OverflowError) as error:
        raise DatasetError(f"{file}: cut short or damaged ({error}).") from error
    return Navmesh(
        bounds=bounds,
        cell_height_m=round(cell_height, 6),
        agent_radius_m=round(radius, 6),
        agent_height_m=round(height, 6),
        triangles_m=triangles,
    )


def _tile(file: Path) -> tuple[bytes, int]:
    data = read_bytes(file)
    at = data.find(_TILE)
    if at < 0 or len(data) < at + _HEADER_BYTES:
        raise DatasetError(f"{file}: not a navmesh (no Detour tile in it).")
    return data, at


def _bounds(file: Path, data: bytes, at: int) -> NavmeshBounds:
    # dtMeshHeader: magic, 14 integers, walkable height/radius/climb, then bmin and bmax.
    values = struct.unpack_from("<6f", data, at + 72)
    if not np.isfinite(values).all() or values[0] >= values[3] or values[2] >= values[5]:
        raise DatasetError(f"{file}: its bounds make no sense: {values}.")
    return NavmeshBounds(low=values[:3], high=values[3:])


def _read_tile(data: bytes, at: int) -> Array:
    """Returns the triangles (T, 3, 3) of all polygons."""
    counts = struct.unpack_from("<6i", data, at + 24)
    if min(counts) < 0 or min(counts[:2]) < 1:
        raise ValueError(f"its numbers of polygons, corners and so on are {counts}")
    polygon_count, corner_count, link_count, detail_count, extra_count, triangle_count = counts
    at += _HEADER_BYTES
    corners = np.frombuffer(data, "<f4", 3 * corner_count, at).reshape(-1, 3).astype(float)
    at += 12 * corner_count
    polygons = np.frombuffer(data, _POLYGON, polygon_count, at)
    if not (np.abs(corners) <= LARGEST).all():
        raise ValueError("a corner is not finite")
    if not ((polygons["count"] >= 3) & (polygons["count"] <= 6)).all():
        raise ValueError("a polygon does not have 3 to 6 corners")
    at += _POLYGON.itemsize * polygon_count + _LINK_BYTES * link_count
    details = np.frombuffer(data, _DETAIL, detail_count, at)
    at += _DETAIL.itemsize * detail_count
    extra = np.frombuffer(data, "<f4", 3 * extra_count, at).reshape(-1, 3).astype(float)
    at += 12 * extra_count
    indices = np.frombuffer(data, "u1", 4 * triangle_count, at).reshape(-1, 4)
    triangles = []
    for polygon, detail in zip(polygons, details, strict=True):
        own = corners[polygon["corners"][: polygon["count"]]]
        more = extra[detail["corner_at"] :][: detail["corners"]]
        chosen = indices[detail["triangle_at"] :][: detail["triangles"], :3]
        triangles.append(np.concatenate((own, more))[chosen])
    return np.concatenate(triangles)


def _draw(grid: Array, triangle: Array) -> None:
    """Lowers the cells under a triangle to its height; x and z of its corners are in cells."""
    a, b, c = triangle
    twice = (b[0] - a[0]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[0] - a[0])
    low = np.maximum(np.ceil(triangle[:, [0, 2]].min(axis=0) - 1e-9), 0).astype(int)
    high = np.minimum(np.floor(triangle[:, [0, 2]].max(axis=0) + 1e-9) + 1, grid.shape).astype(int)
    if math.isclose(twice, 0.0, abs_tol=1e-12) or (low >= high).any():
        return
    x, z = np.mgrid[low[0] : high[0], low[1] : high[1]]
    u = ((x - a[0]) * (c[2] - a[2]) - (z - a[2]) * (c[0] - a[0])) / twice
    v = ((b[0] - a[0]) * (z - a[2]) - (b[2] - a[2]) * (x - a[0])) / twice
    inside = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9)
    height = a[1] + u * (b[1] - a[1]) + v * (c[1] - a[1])
    part = grid[low[0] : high[0], low[1] : high[1]]
    part[inside] = np.minimum(part, height)[inside]


WALL_HEIGHT_M = 2.7
WALL_THICKNESS_M = 0.1


def shell(bounds: NavmeshBounds) -> tuple[CollisionSource, ...]:
    """Returns floor and four outer walls as boxes in the y-up stage frame, floor at y = 0."""
    low, high, t = bounds.low, bounds.high, WALL_THICKNESS_M
    cx, cz = (low[0] + high[0]) / 2, (low[2] + high[2]) / 2
    hx, hz = (high[0] - low[0]) / 2, (high[2] - low[2]) / 2
    wall_y, half_y = WALL_HEIGHT_M / 2, WALL_HEIGHT_M / 2
    boxes = [
        ((cx, -t / 2, cz), (hx + t, t / 2, hz + t)),
        ((low[0] - t / 2, wall_y, cz), (t / 2, half_y, hz + t)),
        ((high[0] + t / 2, wall_y, cz), (t / 2, half_y, hz + t)),
        ((cx, wall_y, low[2] - t / 2), (hx, half_y, t / 2)),
        ((cx, wall_y, high[2] + t / 2), (hx, half_y, t / 2)),
    ]
    return tuple(
        CollisionSource(kind="box", center_m=center, half_size_m=half) for center, half in boxes
    )
