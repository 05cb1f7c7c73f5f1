"""Who collides with whom, as bits of SAPIEN's collision groups.

Two shapes collide when ``a[0] & b[1]`` or ``a[1] & b[0]``, unless they share an ignore bit in
``[2]`` and the number in ``[3]``. Contacts that nobody asks about (a cupboard on the floor, a plate
on a shelf, both at rest) are the larger part of a furnished flat; passive bodies make none.
"""

from __future__ import annotations

from typing import Any

Groups = tuple[int, int]

ROBOT: Groups = (0b0001, 0b1101)
STATIC: Groups = (0b0011, 0b0011)
MOVING: Groups = (0b0011, 0b1111)
"""Objects that are awake: they meet everything."""

HELD: Groups = (0b0010, 0b1110)
"""A held object: it meets everything but the robot."""

FRONT: Groups = (0b0011, 0b0111)
"""Doors and drawers: they meet everything but frozen objects, which they wake before they come."""

PASSIVE: Groups = (0b0100, 0b0000)
"""Furniture bodies: they meet the robot and what moves, not each other."""

FROZEN: Groups = (0b1000, 0b0000)
"""Objects at rest: they meet the robot and objects that move."""

FLOOR_BIT = 1 << 31
"""Ignore bit shared by the robot's base and by whatever lies flat on the floor."""

FURNITURE_BIT = 1 << 29
"""Ignore bit that links of one piece of furniture share: its joints' limits hold it together."""


def set_groups(body: Any, groups: Groups) -> None:
    """Gives all shapes of a body its groups; ignore bits stay."""
    for shape in body.collision_shapes:
        now = shape.get_collision_groups()
        if (now[0], now[1]) != groups:
            now[0], now[1] = groups
            shape.set_collision_groups(now)
