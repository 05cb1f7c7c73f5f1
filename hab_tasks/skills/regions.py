"""Regions of the floor that the base must not leave (S H.2, fridge)."""

from __future__ import annotations

from hab_tasks.arrays import Rows
from hab_tasks.episodes.generators.fridge import SPAWN_REGION
from hab_tasks.episodes.robot_start import Rectangle
from hab_tasks.snapshot import world_to_base

__all__ = ["SPAWN_REGION", "outside"]


def outside(region: Rectangle, front: Rows, base: Rows) -> Rows:
    """Whether bases have left a rectangle before furniture, (N,) bool.

    Args:
        region: The rectangle in the furniture's frame.
        front: (N, 3) x, y, yaw of that frame.
        base: (N, 3) x, y, yaw of the bases.
    """
    local = world_to_base(front, base)
    x, y = local[:, 0], local[:, 1]
    return (x < region.x_m[0]) | (x > region.x_m[1]) | (y < region.y_m[0]) | (y > region.y_m[1])
