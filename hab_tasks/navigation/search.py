"""Search for a goal pose of which only the distribution is known: likely poses, one after another.

An expert that drives to a goal pose which a policy does not observe is hard to imitate: the same
observation has different labels. This one only uses what a policy can see or infer, the map and
where it has stopped before.
"""

from __future__ import annotations

import numpy as np

from hab_tasks.navigation.follower import ShortestPathFollower, angle_between
from hab_tasks.navigation.navigation_map import NavigationMap
from hab_tasks.privileged import Array

MOST_GUESSES = 8

APART_M = 0.45
"""Minimum distance between guesses: Navigate succeeds within 0.3 m of its goal."""

COVERED_M, COVERED_RAD = 0.25, 0.4
"""A guess covers the goal poses within these distances. Success allows more, 0.3 m and 0.5 rad, but
the robot stops beside a guess."""

LEAST_SHARE = 0.04
"""Guesses that cover less of the goal poses are left out."""

ARRIVED_M, ARRIVED_RAD = 0.12, 0.15
"""The robot stops within these distances of a guess."""

TRIED_M, TRIED_RAD = 0.2, 0.35
"""A stop within these distances of a guess has tried it."""

PATIENCE_STEPS = 120
"""After the first guess, one that is not reached within so many steps is left out."""


def apart(poses: Array, count: int = MOST_GUESSES) -> Array:
    """Returns the first poses that are `APART_M` from each other, (G, 3).

    Args:
        poses: (K, 3) x, y [m] and yaw [rad], the most likely ones first.
        count: Most poses.
    """
    guesses = np.empty((0, 3))
    for pose in poses:
        gaps_m = np.linalg.norm(guesses[:, :2] - pose[:2], axis=1)
        if len(guesses) < count and (gaps_m >= APART_M).all():
            guesses = np.vstack((guesses, pose))
    return guesses


def covering(poses: Array, count: int = MOST_GUESSES) -> Array:
    """Returns poses near which equally likely ones are, (G, 3); each covers the most of the rest.

    Args:
        poses: (K, 3) x, y [m] and yaw [rad].
        count: Most poses.
    """
    gaps_m = np.linalg.norm(poses[:, None, :2] - poses[None, :, :2], axis=-1)
    turns_rad = np.abs(np.angle(np.exp(1j * np.subtract.outer(poses[:, 2], poses[:, 2]))))
    covers = (gaps_m < COVERED_M) & (turns_rad < COVERED_RAD)
    left, found = np.ones(len(poses), dtype=bool), []
    for _ in range(min(count, len(poses))):
        counts = (covers & left).sum(axis=1)
        best = int(counts.argmax())
        if counts[best] < LEAST_SHARE * len(poses):
            break
        found.append(best)
        left &= ~covers[best]
    return poses[found]


class PoseSearch:
    """Drives to the first of some poses, stops there, then to the nearest one left, and so on."""

    def __init__(self, map_: NavigationMap, guesses: Array, repeat: int = 1) -> None:
        """Searches on a map.

        Args:
            map_: The map.
            guesses: (G, 3) x, y [m] and yaw [rad], the first one to try first.
            repeat: Number of steps for which each action is executed.
        """
        self._map, self._guesses, self._repeat = map_, guesses, repeat
        self._left = list(range(len(guesses)))
        self._follower = self._follow(0)
        self._patience_steps: int | None = None

    def action(self, base: Array, stopped: bool) -> int:
        """Returns the cell of ``base_discrete`` for a base pose (3,): x, y [m] and yaw [rad].

        Args:
            base: The base pose.
            stopped: Whether the last action was the stop action.
        """
        if stopped:
            self._left = [one for one in self._left if not self._tries(base, one)]
        if self._patience_steps is not None:
            self._patience_steps -= self._repeat
            if self._patience_steps < 0 and self._aim in self._left:
                self._left.remove(self._aim)
        if self._aim not in self._left:
            self._next(base)
        return self._follower.action(base)

    def _next(self, base: Array) -> None:
        """Aims at the nearest guess left; if all were wrong, at all once more."""
        self._left = self._left or list(range(len(self._guesses)))
        gaps_m = np.linalg.norm(self._guesses[self._left, :2] - base[:2], axis=1)
        self._follower = self._follow(self._left[int(gaps_m.argmin())])
        self._patience_steps = PATIENCE_STEPS

    def _follow(self, number: int) -> ShortestPathFollower:
        """Returns a follower to a guess, which it takes as its aim."""
        self._aim = number
        return ShortestPathFollower(
            self._map,
            self._guesses[number],
            self._repeat,
            arrived_m=ARRIVED_M,
            arrived_rad=ARRIVED_RAD,
        )

    def _tries(self, base: Array, number: int) -> bool:
        """Whether a stop at a base pose tries a guess."""
        guess = self._guesses[number]
        gap_m = float(np.linalg.norm(guess[:2] - base[:2]))
        return gap_m < TRIED_M and abs(angle_between(guess[2], base[2])) < TRIED_RAD
