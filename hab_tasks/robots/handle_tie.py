"""Spring between the hand and a held handle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hab_tasks.constants import CONTROL_HZ, EE_STEP_M, GRASP_RADIUS_M

LOST_STEPS = CONTROL_HZ // 2
"""Steps out of reach after which a handle is lost: half a second."""


@dataclass(frozen=True, kw_only=True)
class HandleSpring:
    """Parameters of the spring.

    Attributes:
        stiffness_n_m, damping_n_s_m: Stiffness and damping per axis.
        force_n: Maximum force per axis; about the load capacity of Fetch's arm at half reach.
        draw_in_m: Step per action by which a handle grasped at a distance is drawn in; equal to
            the hand's maximum step.
        reach_m: Distance to the hand from which a handle counts as out of reach.
        lost_steps: Number of actions out of reach after which it is lost.
    """

    stiffness_n_m: float = 3000.0
    damping_n_s_m: float = 150.0
    force_n: float = 200.0
    draw_in_m: float = EE_STEP_M
    reach_m: float = GRASP_RADIUS_M
    lost_steps: int = LOST_STEPS

    def drawn_in(self, place_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns the handle's target position (3,) in the hand one action later."""
        distance_m = float(np.linalg.norm(place_m))
        if distance_m <= self.draw_in_m:
            return np.zeros(3, dtype=np.float32)
        return (place_m * (1.0 - self.draw_in_m / distance_m)).astype(np.float32)


HANDLE_SPRING = HandleSpring()
