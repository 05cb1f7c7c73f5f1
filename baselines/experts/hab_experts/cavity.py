"""Ways of the hand into a fridge or shelf and out of it, for the experts of Pick and Place.

A straight way would meet a board or a wall. The hand moves before the opening to the height of its
goal, turns to it, and goes in and out along the axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hab_experts.handle import in_base, straight
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.privileged import Array

OUT_M = 0.03
"""The hand goes so much farther out than where it moves and turns before the opening."""

NEAREST_X_M = 0.41
"""The controller brings the hand no nearer to the base along x."""

IN_LINE_M, ASIDE_M = 0.05, 0.07
"""The hand goes in within the first distance of the line to the object, and leaves it again beyond
the second."""


@dataclass(frozen=True, kw_only=True)
class Cavity:
    """A fridge or shelf that opens to one side.

    Attributes:
        frame: (3,) x, y [m] and yaw [rad] of a frame that faces out of it.
        outside_m: Distance of the hand ahead of that frame where it moves before the opening.
        lowest_m: A hand below this height is not inside.
        half_width_m: Nor is one so far aside.
    """

    frame: Array
    outside_m: float
    lowest_m: float = 0.0
    half_width_m: float = math.inf


@dataclass(frozen=True, kw_only=True)
class Inside:
    """A cavity in the base frame: where its frame is and where it faces, each (3,)."""

    cavity: Cavity
    root_m: Array
    axis: Array

    @staticmethod
    def of(state: Snapshot, cavity: Cavity) -> Inside:
        """Returns a cavity of the world."""
        frame, axes = cavity.frame, np.asarray(state.base_axes[0], dtype=float)
        ahead = np.array((math.cos(frame[2]), math.sin(frame[2]), 0.0))
        return Inside(
            cavity=cavity,
            root_m=in_base(state, np.array((frame[0], frame[1], 0.0))),
            axis=axes.T @ ahead,
        )

    def out_m(self, point_m: Array) -> float:
        """Returns how far a point (3,) is ahead of the frame."""
        return float((point_m - self.root_m) @ self.axis)

    def way_out(self, hand_m: Array) -> Array | None:
        """Returns the motion (3,) of a hand that leaves; None once it is out, or not inside."""
        gap_m = self.cavity.outside_m + OUT_M - self.out_m(hand_m)
        across = np.array((-self.axis[1], self.axis[0], 0.0))
        aside = abs(float((hand_m - self.root_m) @ across)) > self.cavity.half_width_m
        below = hand_m[2] <= self.cavity.lowest_m
        if gap_m <= 0 or hand_m[0] <= NEAREST_X_M or aside or below:
            return None
        return straight((gap_m + 0.02) * self.axis + np.array((0.0, 0.0, 0.01)))

    def way_in(self, hand_m: Array, goal_m: Array) -> Array:
        """Returns the motion (3,) of a hand to a goal (3,) inside."""
        outside_m, off_m = self.cavity.outside_m, hand_m - goal_m
        aside_m = off_m - self.axis * (off_m @ self.axis)
        level_m, height_m = float(np.linalg.norm(aside_m[:2])), abs(float(off_m[2]))
        out = hand_m + self.axis * (outside_m - self.out_m(hand_m))
        if self.out_m(hand_m) > outside_m - 0.05 or hand_m[0] < NEAREST_X_M + 0.02:
            if height_m > IN_LINE_M:
                goal_m = np.array((out[0], out[1], goal_m[2]))
            elif level_m > IN_LINE_M:
                goal_m = self._before(goal_m)
        elif math.hypot(level_m, height_m) > ASIDE_M:
            goal_m = out
        return straight(goal_m - hand_m)

    def _before(self, goal_m: Array) -> Array:
        """Returns the point (3,) before the opening from which a point inside is reached."""
        start_m = goal_m + self.axis * (self.cavity.outside_m - self.out_m(goal_m))
        if start_m[0] < NEAREST_X_M:
            start_m = goal_m + self.axis * ((NEAREST_X_M - goal_m[0]) / self.axis[0])
        return start_m
