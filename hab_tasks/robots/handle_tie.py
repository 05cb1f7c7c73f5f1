"""The spring between a hand and the handle that it holds: its numbers, and how it is drawn in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hab_tasks.constants import CONTROL_HZ, EE_STEP_M, GRASP_RADIUS_M

LOST_STEPS = CONTROL_HZ // 2
"""A handle that is out of reach for half a second is lost."""


@dataclass(frozen=True, kw_only=True)
class HandleSpring:
    """The numbers of the spring.

    Attributes:
        stiffness_n_m, damping_n_s_m: Of the handle's place in the hand, on each axis.
        force_n: It pulls no harder on each axis; Fetch's arm can hold about as much at half reach.
        draw_in_m: A handle that was taken at a distance comes nearer by this much in an action, the
            hand's own largest step.
        reach_m: Farther from the hand than this, a handle is on its way to be lost.
        lost_steps: It is after so many actions.
    """

    stiffness_n_m: float = 3000.0
    damping_n_s_m: float = 150.0
    force_n: float = 200.0
    draw_in_m: float = EE_STEP_M
    reach_m: float = GRASP_RADIUS_M
    lost_steps: int = LOST_STEPS

    def drawn_in(self, place_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns where the handle (3,) is to be in the hand one action later."""
        distance_m = float(np.linalg.norm(place_m))
        if distance_m <= self.draw_in_m:
            return np.zeros(3, dtype=np.float32)
        return (place_m * (1.0 - self.draw_in_m / distance_m)).astype(np.float32)


HANDLE_SPRING = HandleSpring()
