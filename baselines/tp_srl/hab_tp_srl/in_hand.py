"""Where an object is in the hand: as it stood when the hand closed, or as it is seen there."""

from __future__ import annotations

import numpy as np
from hab_spa.shapes import Array


class InHand:
    """Where an object is in the hand.

    Points are in the resting frame of `TaskView`.

    Attributes:
        in_ee_m: (3,) the object in the end-effector's frame.
        up_in_ee: (3,) the direction in that frame that was up when the hand closed.
        slides: Whether it may slide in the hand, as what is taken out of a drawer.
    """

    def __init__(self) -> None:
        """Holds nothing yet."""
        self.in_ee_m, self.up_in_ee, self.slides = np.zeros(3), np.eye(3)[2], False
        self._reached_m: Array | None = None
        self._taken_m, self._frame_from_ee = np.zeros(3), np.eye(3)

    @property
    def reaches(self) -> bool:
        """Whether a pick has not closed the hand yet."""
        return self._reached_m is not None

    def reach(self, point_m: Array | None, slides: bool) -> None:
        """Notes where a pick reaches to, (3,); None for another skill."""
        self._reached_m = point_m
        if point_m is not None:
            self.slides = slides

    def close(self, hand_m: Array, frame_from_ee: Array) -> None:
        """Notes that the hand that reached holds something, at (3,) and turned by (3, 3)."""
        assert self._reached_m is not None
        self.in_ee_m = frame_from_ee.T @ (self._reached_m - hand_m)
        self.up_in_ee = frame_from_ee[2]
        self._reached_m, self._taken_m, self._frame_from_ee = None, hand_m, frame_from_ee

    def place_m(self) -> Array:
        """Returns where (3,) what is held was when the hand closed."""
        return self._taken_m + self._frame_from_ee @ self.in_ee_m
