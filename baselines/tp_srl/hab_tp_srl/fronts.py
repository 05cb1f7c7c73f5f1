"""Whether doors and drawers are closed, seen by the head camera.

Before one is opened, the robot sees its closed front; where it grasps, it feels the handle. What is
no longer there when it is open was the front; it is closed again if that is seen where it was.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from hab_spa.shapes import Array
from numpy.typing import NDArray

from hab_tp_srl.sight import Look

AROUND_M = 0.4
"""The front is what was seen so near to the hand when it grasped the handle."""

SAME_M = 0.045
"""A front seen so near to where it was is closed: a drawer may stand 5 cm out, and the fridge's
handle 9 cm."""

LEAST_SEEN, LEAST_VIEW = 20, 0.3
"""A front needs so many points, and such a share of them in view."""

MOST_CHANGED = 0.3
"""Of these, such a share may be gone or nearer. On 30 looks that were watched, closed fronts had
0.05 at most, and others 0.67 at least."""


class Fronts:
    """The closed fronts of an episode's doors and drawers, in a frame that does not move."""

    def __init__(self) -> None:
        """Has seen nothing yet."""
        self._surfaces_m: dict[int, Array] = {}
        self._hands_m: dict[int, Array] = {}

    def see(self, number: int, points_m: Array) -> None:
        """Notes surfaces (P, 3) seen before the handle was grasped: till then it is closed."""
        if number not in self._hands_m:
            before_m = self._surfaces_m.get(number, np.zeros((0, 3)))
            self._surfaces_m[number] = np.concatenate((before_m, points_m))

    def touch(self, number: int, hand_m: Array) -> None:
        """Notes where the hand (3,) first grasped its handle."""
        self._hands_m.setdefault(number, hand_m)

    def keep(self, number: int, moved: Callable[[Array], NDArray[np.bool_]]) -> None:
        """Keeps what is not there when a door or drawer is open, without the wall beside it.

        Args:
            number: Its number.
            moved: Whether points (P, 3) are not there.
        """
        points_m = self.of(number)
        self._surfaces_m[number] = points_m[moved(points_m)]

    def of(self, number: int) -> Array:
        """Returns the points (P, 3) of a closed front, if it was seen and its handle grasped."""
        if number not in self._surfaces_m or number not in self._hands_m:
            return np.zeros((0, 3))
        points_m = self._surfaces_m[number]
        points_m = points_m[np.linalg.norm(points_m - self._hands_m[number], axis=1) < AROUND_M]
        return points_m if len(points_m) >= LEAST_SEEN else np.zeros((0, 3))


def is_there(look: Look, front_m: Array) -> bool | None:
    """Returns whether a front (P, 3), in the base frame, is seen in a look.

    Returns:
        None if too little of it is in view.
    """
    _, gaps_m = look.behind_m(front_m)
    if len(gaps_m) < max(LEAST_SEEN, LEAST_VIEW * len(front_m)):
        return None
    return bool((np.abs(gaps_m) > SAME_M).mean() <= MOST_CHANGED)


def changed(look: Look, front_m: Array) -> NDArray[np.bool_]:
    """Whether points of a front (P, 3), in the base frame, are seen not to be there in a look."""
    which, gaps_m = look.behind_m(front_m)
    found = np.zeros(len(front_m), dtype=bool)
    found[which] = np.abs(gaps_m) > SAME_M
    return found
