"""Substitute for a stage mesh without file or convex parts: floor and outer walls.

ReplicaCAD's navmesh files contain the bounding box of their source geometry, which is that of the
stage mesh. `hab_tasks.world.scenes.walls` computes the inner walls.
"""

from __future__ import annotations

from hab_tasks.world.scenes.habitat.navmesh import NavmeshBounds
from hab_tasks.world.scenes.spec import CollisionSource

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
