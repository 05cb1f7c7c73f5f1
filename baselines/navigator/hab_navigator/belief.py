"""What the robot believes of the goal pose: the network's distribution but for what was tried.

For a hand that comes level, what has been seen around the point tells from where it can come.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hab_navigator.network import ASIDE_RAD, HEADINGS
from hab_navigator.robot_map import CELL_M, RobotMap
from hab_navigator.views import SIDE, middle_m
from hab_tasks.privileged import Array

VOXEL_M = 0.04
SIDE_VOXELS, HIGH_VOXELS = 48, 50
"""Horizontal and vertical numbers of voxels: 1.9 m around the point, and 2 m from the floor."""

SIDES = 24
"""Number of level directions from which the hand may come."""

RISE_M = 0.06
"""The hand's way is a level line this far above the point."""

WAY_M = (0.15, 0.65)
"""Part of the way that counts, by distance from the point; nearer is the object itself."""


class NearSpace:
    """Surfaces around a point (3,), in a map's frame."""

    def __init__(self, point_m: Array) -> None:
        """Has seen nothing yet."""
        self._point_m = np.asarray(point_m, dtype=float)
        self._low_m = np.append(self._point_m[:2] - VOXEL_M * SIDE_VOXELS / 2, 0.0)
        self._seen = np.zeros((SIDE_VOXELS, SIDE_VOXELS, HIGH_VOXELS), dtype=bool)

    def add(self, points_m: NDArray[np.floating]) -> None:
        """Adds surface points (P, 3)."""
        cells = np.floor((points_m - self._low_m) / VOXEL_M).astype(np.intp)
        inside = ((cells >= 0) & (cells < self._seen.shape)).all(axis=1)
        self._seen[tuple(cells[inside].T)] = True

    def clearances_m(self) -> Array:
        """Returns how near the hand's way from each side (SIDES,) comes to what has been seen.

        Side k is at the angle ``2 pi k / SIDES`` from the point.
        """
        if not self._seen.any():
            return np.full(SIDES, np.inf)
        gaps_m: Array = VOXEL_M * np.asarray(ndimage.distance_transform_edt(~self._seen))
        cells = np.floor((_WAYS_M + self._point_m - self._low_m) / VOXEL_M).astype(np.intp)
        cells = np.clip(cells, 0, np.array(self._seen.shape) - 1)
        return gaps_m[tuple(np.moveaxis(cells, -1, 0))].min(axis=1)


def _ways() -> Array:
    """Returns points (SIDES, P, 3) on the hand's ways, relative to the point."""
    along_m = np.arange(WAY_M[0], WAY_M[1], VOXEL_M)
    angles_rad = 2 * math.pi * np.arange(SIDES) / SIDES
    x, y = (along_m * turn(angles_rad)[:, None] for turn in (np.cos, np.sin))
    return np.stack((x, y, np.full_like(x, RISE_M)), axis=-1)


_WAYS_M = _ways()


FOUND_M = (0.15, 0.35)
"""A stop at a place finds all goals within the first distance, and none beyond the second:
Navigate's 0.3 m, but for where exactly the robot comes to stop."""

EXCLUDED_M = (0.28, 0.33)
"""Likewise a stop in vain, whose pose is known, excludes goals."""

TRIED_SHARE = 0.9
"""Share of its worth that a place loses at which the next skill was tried in vain."""

HAND_M = 0.12
"""Room that the hand's way needs on all sides."""

BLOCKED_SHARE = 0.1
"""Worth of a place from which something seen is in the hand's way, as a share."""

COVERED_RAD = 0.5
"""Both with the heading so near to its own."""


@dataclass(frozen=True, kw_only=True)
class Reach:
    """Where the point may be, in the base frame, for the skill that follows.

    Attributes:
        distance_m: Its least and greatest distance.
        bearing_rad: Its least and greatest bearing, counterclockwise from ahead.
        level: Whether the hand comes to it level, not from above.
    """

    distance_m: tuple[float, float]
    bearing_rad: tuple[float, float]
    level: bool

    def includes(self, distances_m: Array, bearings_rad: Array) -> NDArray[np.bool_]:
        """Whether the skill can start where the point is at distances and bearings (broadcast)."""
        (near_m, far_m), (right_rad, left_rad) = self.distance_m, self.bearing_rad
        near = (distances_m >= near_m) & (distances_m <= far_m)
        return near & (bearings_rad >= right_rad) & (bearings_rad <= left_rad)


class GoalBelief:
    """A distribution over cells and headings around the point to go to, in a map's frame.

    Attributes:
        places_m: (SIDE, SIDE, 2) the cells.
        yaws_rad: (HEADINGS, SIDE, SIDE) the headings there.
        found: (HEADINGS, SIDE, SIDE) share of the goals that a stop in a pose finds.
    """

    def __init__(self, map_: RobotMap, reach: Reach | None = None) -> None:
        """Believes nothing yet; the map has seen the point.

        Args:
            map_: The map.
            reach: Where the next skill can start; None for any pose.
        """
        self._middle_m = middle_m(map_)
        self.places_m: Array = self._middle_m + _OFFSETS_M
        gaps_m = map_.point_m - self.places_m
        facing_rad = np.arctan2(gaps_m[..., 1], gaps_m[..., 0])
        self.yaws_rad: NDArray[Any] = facing_rad + ASIDE_RAD * _BINS[:, None, None]
        self._shares = np.zeros((HEADINGS, SIDE, SIDE))
        bearings_rad: Array = np.zeros(self.yaws_rad.shape) - ASIDE_RAD * _BINS[:, None, None]
        distances_m = np.linalg.norm(gaps_m, axis=-1)
        # Navigate would have ended at a right stop; a skill can fail where another try succeeds.
        self._tried_share = 1.0 if reach is None else TRIED_SHARE
        self._suits = np.ones_like(self._shares)
        if reach is not None:
            self._suits[:] = reach.includes(distances_m, bearings_rad)
        sides = np.round(np.arctan2(-gaps_m[..., 1], -gaps_m[..., 0]) / (2 * math.pi) * SIDES)
        self._sides, self._open = sides.astype(int) % SIDES, np.ones(SIDES)
        self._left = np.ones_like(self._shares)
        self.found = self._shares

    def learn(self, shares: Array) -> None:
        """Takes the network's distribution (HEADINGS, SIDE, SIDE)."""
        self._shares = shares

    def see(self, clearances_m: Array) -> None:
        """Takes into account how much room the hand's way has from each side (SIDES,)."""
        room = np.clip(clearances_m / HAND_M, BLOCKED_SHARE, 1.0)
        self._open = ndimage.convolve1d(room, (0.25, 0.5, 0.25), mode="wrap")

    def exclude(self, pose: Array) -> None:
        """Excludes the goals that a stop in a pose (3,) would have found."""
        near = _share(np.linalg.norm(self.places_m - pose[:2], axis=-1), EXCLUDED_M)
        turns_rad = np.angle(np.exp(1j * (self.yaws_rad - pose[2])))
        self._left *= 1.0 - self._tried_share * (near * _covered_share(turns_rad))

    def forgive(self) -> None:
        """Takes all exclusions back."""
        self._left[:] = 1.0

    def update(self, free: NDArray[np.bool_]) -> None:
        """Computes `found` for cells (SIDE, SIDE) that are free or not; no goal is in others."""
        goals = self._shares * self._left * free
        self.found = (
            self._open[self._sides]
            * self._suits
            * ndimage.convolve(goals, _COVERED, mode="constant")
        )

    def cell_of(self, pose: Array) -> tuple[int, int] | None:
        """Returns the cell of a pose (3,); None outside."""
        x, y = np.floor((pose[:2] - self._middle_m) / CELL_M).astype(int) + SIDE // 2
        return (int(x), int(y)) if 0 <= x < SIDE and 0 <= y < SIDE else None

    def found_at(self, pose: Array) -> float:
        """Returns the share of the goals that a stop in a pose (3,) finds."""
        cell = self.cell_of(pose)
        if cell is None:
            return 0.0
        ahead_rad = float(self.yaws_rad[HEADINGS // 2, cell[0], cell[1]])
        heading = round(math.remainder(pose[2] - ahead_rad, 2 * math.pi) / ASIDE_RAD)
        heading += HEADINGS // 2
        return float(self.found[heading, cell[0], cell[1]]) if 0 <= heading < HEADINGS else 0.0


def _share(gaps_m: Array, bounds_m: tuple[float, float]) -> Array:
    """Returns 1 up to the first distance, 0 from the second on, and a line between them."""
    return np.clip((bounds_m[1] - gaps_m) / (bounds_m[1] - bounds_m[0]), 0.0, 1.0)


def _covered_share(turns_rad: Array) -> Array:
    """Returns which share of the headings of bins, so far from a stop's heading, it finds."""
    return np.clip((COVERED_RAD + ASIDE_RAD / 2 - np.abs(turns_rad)) / ASIDE_RAD, 0.0, 1.0)


_STEPS_M = (np.arange(SIDE) - (SIDE - 1) / 2) * CELL_M
_OFFSETS_M: Any = np.stack(np.meshgrid(_STEPS_M, _STEPS_M, indexing="ij"), axis=-1)
_STEPS = np.arange(-3, 4)
_DISC = _share(CELL_M * np.hypot(_STEPS[:, None], _STEPS[None]), FOUND_M)
_COVERED = _covered_share(ASIDE_RAD * np.array((-1, 0, 1)))[:, None, None] * _DISC
_BINS = np.arange(HEADINGS) - HEADINGS // 2
