"""Ways of the hand into the fridge and out of it, for the experts of Pick and Place.

A straight way would meet a shelf or a wall. The hand rises before the fridge to the height of its
goal, turns to it, and goes in and out along the fridge's axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hab_experts.handle import in_base, straight
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.privileged import Array

OUTSIDE_M, OUT_M = 0.42, 0.45
"""Distances of the hand from the fridge's root along its axis: where it rises and turns to the
object, and from where it returns to rest."""

SHELF_M = 1.16
"""A hand below this height is not on the fridge's shelf."""

NEAREST_X_M = 0.41
"""The controller brings the hand no nearer to the base along x."""

IN_LINE_M, ASIDE_M = 0.05, 0.07
"""The hand enters the fridge within the first distance of the line to the object, and leaves it
again beyond the second."""


@dataclass(frozen=True, kw_only=True)
class Inside:
    """The fridge in the base frame: where its root is, and where it faces, each (3,)."""

    root_m: Array
    axis: Array

    @staticmethod
    def of(state: Snapshot, frame: Array) -> Inside:
        """Returns the fridge whose frame (3,) is at x, y [m] and yaw [rad] of the world."""
        axes = np.asarray(state.base_axes[0], dtype=float)
        ahead = np.array((math.cos(frame[2]), math.sin(frame[2]), 0.0))
        return Inside(
            root_m=in_base(state, np.array((frame[0], frame[1], 0.0))), axis=axes.T @ ahead
        )

    def out_m(self, point_m: Array) -> float:
        """Returns how far a point (3,) is ahead of the root."""
        return float((point_m - self.root_m) @ self.axis)

    def way_out(self, hand_m: Array) -> Array | None:
        """Returns the motion (3,) of a hand that leaves; None once it is out, or below."""
        gap_m = OUT_M - self.out_m(hand_m)
        if gap_m <= 0 or hand_m[0] <= NEAREST_X_M or hand_m[2] <= SHELF_M:
            return None
        return straight((gap_m + 0.02) * self.axis + np.array((0.0, 0.0, 0.01)))

    def way_in(self, hand_m: Array, goal_m: Array) -> Array:
        """Returns the motion (3,) of a hand to a goal (3,) inside."""
        off_m = hand_m - goal_m
        aside_m = off_m - self.axis * (off_m @ self.axis)
        level_m, height_m = float(np.linalg.norm(aside_m[:2])), abs(float(off_m[2]))
        out = hand_m + self.axis * (OUTSIDE_M - self.out_m(hand_m))
        if self.out_m(hand_m) > OUTSIDE_M - 0.05 or hand_m[0] < NEAREST_X_M + 0.02:
            if height_m > IN_LINE_M:
                goal_m = np.array((out[0], out[1], goal_m[2]))
            elif level_m > IN_LINE_M:
                goal_m = self._before(goal_m)
        elif math.hypot(level_m, height_m) > ASIDE_M:
            goal_m = out
        return straight(goal_m - hand_m)

    def _before(self, goal_m: Array) -> Array:
        """Returns the point (3,) before the fridge from which a point inside is reached."""
        start_m = goal_m + self.axis * (OUTSIDE_M - self.out_m(goal_m))
        if start_m[0] < NEAREST_X_M:
            start_m = goal_m + self.axis * ((NEAREST_X_M - goal_m[0]) / self.axis[0])
        return start_m
