"""Policies that are stuck: the most likely action of a state can be to stay there for ever."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

STEPS, MOTION_RAD = 20, 0.004
"""An arm that for so many steps moves no joint more than this per step is stuck. Then so many
actions are drawn, as in training, where a hand over its goal would also open by chance."""


@dataclass
class Stillness:
    """How long an arm has stood still.

    Attributes:
        arm_rad: (7,) the joints in the last step.
        still_steps: Number of steps since they moved, or since actions were last drawn for it.
        draws_left: Number of actions still to be drawn.
    """

    arm_rad: NDArray[np.float32] | None = None
    still_steps: int = 0
    draws_left: int = 0

    def draws(self, arm_rad: NDArray[np.float32]) -> bool:
        """Whether the action of this step is drawn; to be called in every step.

        Args:
            arm_rad: (7,) the joints.
        """
        before, self.arm_rad = self.arm_rad, arm_rad.copy()
        moves = before is None or np.abs(arm_rad - before).max() > MOTION_RAD
        self.still_steps = 0 if moves or self.draws_left else self.still_steps + 1
        if self.still_steps == STEPS:
            self.still_steps, self.draws_left = 0, STEPS
        drawn = self.draws_left > 0
        self.draws_left -= drawn
        return drawn
