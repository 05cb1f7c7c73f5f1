"""Navigate with a map, a learned distribution of the goal pose, and shortest ways.

The robot drives to the place where a stop is worth most for the time that it takes. If a stop was
not at the goal, it excludes what the stop has tried, and goes on.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from scipy import ndimage

from hab_ppo.navigator.network import ASIDE_RAD, HEADINGS, GoalNetwork
from hab_ppo.navigator.robot_map import CELL_M, RobotMap, turned
from hab_ppo.navigator.seen_floor import SeenFloor
from hab_ppo.navigator.views import SIDE, View, inputs, middle_m
from hab_tasks.navigation import ShortestPathFollower
from hab_tasks.privileged import Array
from hab_tasks.robots.control_modes import STOP_CELL

REPEAT = 4
"""Steps for which each action is executed."""

FOUND_M = (0.15, 0.35)
"""A stop at a place finds all goals within the first distance, and none beyond the second:
Navigate's 0.3 m, but for where exactly the robot comes to stop."""

EXCLUDED_M = (0.28, 0.33)
"""Likewise a stop in vain, whose pose is known, excludes goals."""

COVERED_RAD = 0.5
"""Both with the heading so near to its own."""

SAME_M = 0.22
"""Places so near to each other count as the same."""

AT_PLACE_M = 1.0
"""Time that turning at a place takes, as a way."""

STOP_M = 0.2
"""Time that a stop takes, as a way."""

LEAST_SHARE = 0.01
"""Stops on the way that find less of the goals than this are left out."""

MORE_AHEAD = 1.1
"""Nor does it stop where the last action has brought it closer to goals by this factor."""

ARRIVED_M, ARRIVED_RAD = 0.12, 0.15
"""The robot has arrived within these distances of a place."""

RADII_M = (0.3, 0.25, 0.2, 0.15)
"""Radii of the base for which a way is looked for: cells make gaps look narrower than they are."""

REACHED_M = 1.6
"""A way to the point ends so near to it."""

REFRESH_ACTIONS = 5
"""The network looks again after so many actions: the map has changed."""

PATIENCE_ACTIONS = 45
"""A place that is not reached within so many actions is excluded."""

KEEP_SHARE = 1.3
"""Another place has to be so much better than the one that the robot is driving to."""


class Navigator:
    """Navigates in one episode.

    Attributes:
        map: The robot's map.
        aim: (3,) x, y [m] and yaw [rad] of the place it is driving to, in the map's frame.
    """

    def __init__(
        self,
        network: GoalNetwork,
        device: torch.device | str = "cpu",
        *,
        stops_on_way: bool = True,
    ) -> None:
        """Starts an episode.

        Args:
            network: The goal network.
            device: Its device.
            stops_on_way: Whether to stop also on the way, where that is worth it: a stop that is
                not at the goal costs no more than its time.
        """
        self.map = RobotMap(REPEAT)
        self.aim: Array | None = None
        self._network, self._device, self._stops_on_way = network, device, stops_on_way
        self._tried: list[Array] = []  # poses (3,)
        self._known = np.zeros((HEADINGS, SIDE, SIDE))  # the distribution of the goal pose
        self._found, self._worth = self._known, 0.0
        self._here = 0.0  # the share of goals that a stop at the pose would find
        self._age, self._stopped = 0, False

    def action(self, depth: Any, point_in_base_m: Array, holding: bool) -> int:
        """Returns the cell of ``base_discrete`` for the next `REPEAT` steps.

        Args:
            depth: (H, W, 1) depth image of the head camera as shares of its range.
            point_in_base_m: (3,) the point to go to.
            holding: Whether the hand holds something.
        """
        self.map.look(depth, point_in_base_m)
        floor = self._floor()
        self._choose(floor, float(point_in_base_m[2]), holding)
        assert self.aim is not None
        action = STOP_CELL
        if not self._stops_here():
            follower = ShortestPathFollower(
                floor, self.aim, REPEAT, arrived_m=ARRIVED_M, arrived_rad=ARRIVED_RAD
            )
            action = follower.action(self.map.pose)
        self._stopped = action == STOP_CELL
        self.map.turn(action)
        return action

    def _floor(self) -> SeenFloor:
        """Returns the floor; through gaps that look too narrow if there is no other way."""
        for radius_m in RADII_M:
            floor = SeenFloor(self.map, radius_m)
            reached_m = floor.nearest_free(self.map.point_m)
            if np.linalg.norm(reached_m - self.map.point_m) < REACHED_M:
                break
        return floor

    def view(self, height_m: float, holding: bool) -> View:
        """Returns what the network sees now."""
        return View.of(self.map, height_m, holding)

    def _choose(self, floor: SeenFloor, height_m: float, holding: bool) -> None:
        """Chooses a place to drive to, or keeps the one there is."""
        self._age += 1
        looks = self.aim is None or self._age % REFRESH_ACTIONS == 0
        if self._stopped:
            self._tried.append(self.map.pose)
        elif self._age > PATIENCE_ACTIONS and self.aim is not None:
            self._tried.append(self.aim)
            self._age = 0
        elif not looks and self.aim is not None and floor.is_free(self.aim[:2]):
            return
        if looks:
            self._known = self._distribution(height_m, holding)
        before, self.aim = self.aim, self._best(floor)
        if before is None or np.linalg.norm(self.aim[:2] - before[:2]) > SAME_M:
            self._age = 0

    def _best(self, floor: SeenFloor) -> Array:
        """Returns the pose (3,) that promises most for its cost."""
        places_m: Array = middle_m(self.map) + _OFFSETS_M  # (SIDE, SIDE, 2)
        gaps_m = self.map.point_m - places_m
        facing_rad = np.arctan2(gaps_m[..., 1], gaps_m[..., 0])
        yaws_rad = facing_rad + ASIDE_RAD * _BINS[:, None, None]  # (HEADINGS, SIDE, SIDE)
        free = floor.is_free(places_m)
        shares = np.where(free, self._known, 0.0)
        for tried in self._tried:
            near = _share(np.linalg.norm(places_m - tried[:2], axis=-1), EXCLUDED_M)
            turns_rad = np.angle(np.exp(1j * (yaws_rad - tried[2])))
            shares *= 1.0 - near * _covered_share(turns_rad)
        self._found = ndimage.convolve(shares, _COVERED, mode="constant")
        worth = np.where(free, self._found / self._cost_m(floor, places_m), -1.0)
        self._favour(worth, floor)
        best = np.unravel_index(int(worth.argmax()), worth.shape)
        self._worth = float(worth[best])
        if self._worth > 0.0:
            return np.array((*places_m[best[1:]], yaws_rad[best]))
        self._tried = []  # nothing is left: from the beginning
        place = floor.nearest_free(self.map.point_m)
        ahead_m = self.map.point_m - place
        return np.array((*place, math.atan2(ahead_m[1], ahead_m[0])))

    @torch.no_grad()
    def _distribution(self, height_m: float, holding: bool) -> Array:
        """Returns the network's distribution of the goal pose (HEADINGS, SIDE, SIDE)."""
        logits = self._network(inputs(self.view(height_m, holding)).to(self._device))
        return logits[0].flatten().softmax(0).reshape(logits[0].shape).cpu().numpy()

    def _stops_here(self) -> bool:
        """Whether a stop on the way finds more goals for its time than the place ahead."""
        cell = self._cell_of(self.map.pose)
        if not self._stops_on_way or self._stopped or cell is None:
            return False
        ahead_m = self.map.point_m - self.map.pose[:2]
        aside_rad = math.remainder(
            self.map.pose[2] - math.atan2(ahead_m[1], ahead_m[0]), 2 * math.pi
        )
        heading = round(aside_rad / ASIDE_RAD) + HEADINGS // 2
        if not 0 <= heading < HEADINGS:
            return False
        found, before = float(self._found[heading, cell[0], cell[1]]), self._here
        self._here = found
        return MORE_AHEAD * before > found > max(LEAST_SHARE, STOP_M * self._worth)

    def _cost_m(self, floor: SeenFloor, places_m: Array) -> Array:
        """Returns the cost of going to places (SIDE, SIDE, 2) and of turning there."""
        ways_m = floor.geodesic_field(floor.nearest_free(self.map.pose[:2]))
        cells = floor.cells_of(places_m)
        return AT_PLACE_M + ways_m[cells[..., 0], cells[..., 1]]

    def _favour(self, worth: Array, floor: SeenFloor) -> None:
        """Makes the place that it is driving to worth more, (HEADINGS, SIDE, SIDE)."""
        if self.aim is not None and floor.is_free(self.aim[:2]):
            cell = self._cell_of(self.aim)
            if cell is not None:
                worth[:, cell[0], cell[1]] *= KEEP_SHARE

    def _cell_of(self, pose: Array) -> tuple[int, int] | None:
        """Returns the cell of a view in which a pose (3,) is; None outside of it."""
        x, y = np.floor((pose[:2] - middle_m(self.map)) / CELL_M).astype(int) + SIDE // 2
        return (int(x), int(y)) if 0 <= x < SIDE and 0 <= y < SIDE else None


def _share(gaps_m: Array, bounds_m: tuple[float, float]) -> Array:
    """Returns 1 up to the first distance, 0 from the second on, and a line between them."""
    return np.clip((bounds_m[1] - gaps_m) / (bounds_m[1] - bounds_m[0]), 0.0, 1.0)


def _covered_share(turns_rad: Array) -> Array:
    """Returns which share of the headings of bins, so far from a stop's heading, it finds."""
    return np.clip((COVERED_RAD + ASIDE_RAD / 2 - np.abs(turns_rad)) / ASIDE_RAD, 0.0, 1.0)


def goal_in_map(start: Array, goal: Array) -> Array:
    """Returns a goal pose (3,) in the frame of a map.

    Args:
        start: (3,) the first base pose, x, y [m] and yaw [rad].
        goal: (3,) the goal, likewise.
    """
    place = turned(np.asarray(goal[:2]) - np.asarray(start[:2]), -start[2])
    return np.array((*place, math.remainder(goal[2] - start[2], 2 * math.pi)))


_STEPS_M = (np.arange(SIDE) - (SIDE - 1) / 2) * CELL_M
_OFFSETS_M: Any = np.stack(np.meshgrid(_STEPS_M, _STEPS_M, indexing="ij"), axis=-1)
_STEPS = np.arange(-3, 4)
_DISC = _share(CELL_M * np.hypot(_STEPS[:, None], _STEPS[None]), FOUND_M)
_COVERED = _covered_share(ASIDE_RAD * np.array((-1, 0, 1)))[:, None, None] * _DISC
_BINS = np.arange(HEADINGS) - HEADINGS // 2
