"""Where objects were last seen, so that one that was swept off, or pushed aside, is found again."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from hab_spa.shapes import Array, invert_pose

from hab_tp_srl.sight import IN_HAND_M, LEAST, PAST_M, STANDS_M, Look, middle_m

NEAR_M = 1.3
"""Farther from the base, an object has too few pixels."""

LEFT_SHARE, STANDS_SHARE = 0.5, 0.1
"""An object has left its place if one sees past so much of it, and stands there up to the second
share. Between them, something may hide it."""

SAME_SIDE = 0.8
"""Least cosine between two directions from which one sees the same side of an object."""

LEVEL_M, SMALL_M = 0.15, 0.3
"""What was pushed aside lies about as high as before, and is not larger."""

OTHER_M = 0.08
"""What is seen so near to the place of another object is that one."""


class Watch:
    """Where the objects of an episode were last seen."""

    def __init__(self) -> None:
        """Has seen nothing yet."""
        self._looks: dict[int, Look] = {}

    def moved_m(
        self, look: Look, number: int, here_m: Array, ee_m: Array, others_m: Sequence[Array]
    ) -> Array | None:
        """Returns where (3,) an object is seen that has gone from its place; None if it has not.

        Args:
            look: The look.
            number: Number of the object.
            here_m: (3,) its place in the base frame.
            ee_m: (3,) the hand, which may hold another one.
            others_m: Places (3,) of the other objects.
        """
        if np.hypot(here_m[0], here_m[1]) > NEAR_M:
            return None
        before = self._looks.get(number)
        left_share = 0.0 if before is None else _left_share(before, look, here_m)
        if left_share < LEFT_SHARE and not look.misses(here_m):
            if look.shows(here_m) and left_share < STANDS_SHARE:
                self._looks[number] = look
            return None
        aside_m = self._pushed_m(look, number, here_m, ee_m, others_m)
        found_m = look.fallen_m(here_m) if aside_m is None else aside_m
        return None if found_m is None or _gap_m(found_m, here_m) < STANDS_M else found_m

    def _pushed_m(
        self, look: Look, number: int, here_m: Array, ee_m: Array, others_m: Sequence[Array]
    ) -> Array | None:
        """Returns the middle (3,) of what has appeared near by since the object was last seen."""
        if number not in self._looks:
            return None
        middles_m = [
            middle_m(cloud_m)
            for cloud_m in look.appeared(self._looks[number], here_m)
            if np.ptp(cloud_m, axis=0).max() < SMALL_M
        ]
        taken = [(ee_m, IN_HAND_M), *((other_m, OTHER_M) for other_m in others_m)]
        aside = [
            one_m
            for one_m in middles_m
            if abs(one_m[2] - here_m[2]) < LEVEL_M
            and all(_gap_m(one_m, there_m) > gap_m for there_m, gap_m in taken)
        ]
        return min(aside, key=lambda one_m: _gap_m(one_m, here_m), default=None)


def _left_share(before: Look, after: Look, near_m: Array) -> float:
    """Returns past which share of what was seen around a point (3,) a later look sees.

    The point is in the base frame of the later look. Of what is hardly in view, or was seen from
    another side, it is 0.
    """
    there_m = after.moved_to(before, near_m[None])[0]
    if _side(before, there_m) @ _side(after, near_m) < SAME_SIDE:
        return 0.0
    around = np.linalg.norm(before.points_m - there_m, axis=-1) < STANDS_M
    _, behind_m = after.behind_m(before.moved_to(after, before.points_m[around & ~before.own]))
    return float((behind_m > PAST_M).mean()) if len(behind_m) >= LEAST else 0.0


def _side(look: Look, point_m: Array) -> Array:
    """Returns the direction (3,) in the world in which the camera sees a point (3,)."""
    world_from_base = invert_pose(look.base_from_world)
    in_world_m = world_from_base[:3, :3] @ point_m + world_from_base[:3, 3]
    away_m = in_world_m - look.view.world_from_camera[:3, 3]
    return away_m / np.linalg.norm(away_m)


def _gap_m(one_m: Array, other_m: Array) -> float:
    return float(np.linalg.norm(one_m - other_m))
