"""A stand-in for a stage mesh that is absent: floor and outer walls from the navigation mesh.

ReplicaCAD's navmesh files (Recast/Detour) keep the bounding box of the geometry they were made
from, which is the stage's. The walkable polygons give the floor's height.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hab_tasks.errors import DatasetError
from hab_tasks.scenes.spec import CollisionSource, Vector

WALL_HEIGHT_M = 2.7
WALL_THICKNESS_M = 0.1
_TILE = b"VAND"
_TILE_HEADER_BYTES = 100


@dataclass(frozen=True, kw_only=True)
class NavmeshBounds:
    """The y-up box [m] of the geometry that a navmesh was built from."""

    low: Vector
    high: Vector


def read_navmesh_bounds(file: Path) -> NavmeshBounds:
    """Reads the bounds in a Habitat ``.navmesh`` file.

    Raises:
        DatasetError: The file holds no Detour tile.
    """
    data = file.read_bytes()
    at = data.find(_TILE)
    if at < 0 or len(data) < at + _TILE_HEADER_BYTES:
        raise DatasetError(f"{file}: not a navmesh (no Detour tile in it).")
    # dtMeshHeader: magic, 14 integers, walkable height/radius/climb, then bmin and bmax.
    values = struct.unpack("<6f", data[at + 72 : at + 96])
    if not np.isfinite(values).all() or values[0] >= values[3] or values[2] >= values[5]:
        raise DatasetError(f"{file}: its bounds make no sense: {values}.")
    return NavmeshBounds(low=values[:3], high=values[3:])


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
