"""Collision groups, as bits of SAPIEN's group words.

Two shapes collide if ``a[0] & b[1]`` or ``a[1] & b[0]``, unless they share an ignore bit in ``[2]``
and the number in ``[3]``. Most contacts in a furnished flat are irrelevant (a cupboard on the
floor, a plate on a shelf, both at rest); passive bodies do not generate them.
"""

from __future__ import annotations

from typing import Any

Groups = tuple[int, int]

ROBOT: Groups = (0b0001, 0b1101)
HAND: Groups = (0b10000, 0b1101)
"""The robot's hand: as the robot, and it passes through a held door or drawer."""

STATIC: Groups = (0b0011, 0b0011)
MOVING: Groups = (0b0011, 0b1111)
"""Awake objects: collide with everything."""

HELD: Groups = (0b0010, 0b1110)
"""Held objects: collide with everything except the robot."""

FRONT: Groups = (0b0011, 0b0111)
"""Doors and drawers: collide with all but sleeping objects, which they wake on approach."""

HELD_FRONT: Groups = (0b0010, 0b0111)
"""A door or drawer whose handle is held: as `FRONT`, but it does not collide with the hand."""

PASSIVE: Groups = (0b0100, 0b0000)
"""Furniture bodies: collide with the robot and moving bodies, not with each other."""

FROZEN: Groups = (0b1000, 0b0000)
"""Sleeping objects: collide with the robot and moving objects."""

FLOOR_BIT = 1 << 31
"""Ignore bit shared by the robot's base and flat bodies on the floor."""

FURNITURE_BIT = 1 << 29
"""Ignore bit shared by the links of one piece of furniture, which joint limits keep apart."""


def set_groups(body: Any, groups: Groups) -> None:
    """Sets the groups of all shapes of a body; ignore bits are kept."""
    for shape in body.collision_shapes:
        now = shape.get_collision_groups()
        if (now[0], now[1]) != groups:
            now[0], now[1] = groups
            shape.set_collision_groups(now)
