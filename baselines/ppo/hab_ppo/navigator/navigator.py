"""Navigate with a map, a learned distribution of the goal pose, and shortest ways.

The robot drives to the place where a stop is worth most for the time that it takes, stops, and if
that was not the goal, excludes what the stop has tried and goes on to the next place.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from scipy import ndimage

from hab_ppo.navigator.network import GoalNetwork
from hab_ppo.navigator.robot_map import CELL_M, RobotMap, turned
from hab_ppo.navigator.seen_floor import SeenFloor
from hab_ppo.navigator.views import SIDE, View, inputs, middle_m
from hab_tasks.navigation import ShortestPathFollower
from hab_tasks.privileged import Array
from hab_tasks.robots.control_modes import STOP_CELL

REPEAT = 4
"""Steps for which each action is executed."""

COVERED_M = 0.25
"""A stop finds goals within this distance: less than Navigate's 0.3 m, as it is not exact."""

EXCLUDED_M = 0.22
"""A stop in vain excludes goals within this distance."""

STOP_COST_M = 1.5
"""Time that the turn at a place and the stop take, as a way."""

ARRIVED_M, ARRIVED_RAD = 0.12, 0.15
"""The robot stops within these distances of a place."""

REFRESH_ACTIONS = 5
"""The place is chosen anew every so many actions: the map has changed."""

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

    def __init__(self, network: GoalNetwork, device: torch.device | str = "cpu") -> None:
        """Starts an episode."""
        self.map = RobotMap(REPEAT)
        self.aim: Array | None = None
        self._network, self._device = network, device
        self._tried: list[Array] = []
        self._age, self._stopped = 0, False

    def action(self, depth: Any, point_in_base_m: Array, holding: bool) -> int:
        """Returns the cell of ``base_discrete`` for the next `REPEAT` steps.

        Args:
            depth: (H, W, 1) depth image of the head camera as shares of its range.
            point_in_base_m: (3,) the point to go to.
            holding: Whether the hand holds something.
        """
        self.map.look(depth, point_in_base_m)
        floor = SeenFloor(self.map)
        self._choose(floor, float(point_in_base_m[2]), holding)
        assert self.aim is not None
        follower = ShortestPathFollower(
            floor, self.aim, REPEAT, arrived_m=ARRIVED_M, arrived_rad=ARRIVED_RAD
        )
        action = follower.action(self.map.pose)
        self._stopped = action == STOP_CELL
        self.map.turn(action)
        return action

    def view(self, height_m: float, holding: bool) -> View:
        """Returns what the network sees now."""
        return View.of(self.map, height_m, holding)

    def _choose(self, floor: SeenFloor, height_m: float, holding: bool) -> None:
        """Chooses a place to drive to, or keeps the one there is."""
        if self._stopped:
            self._tried.append(self.map.pose)
            self.aim = None
        elif self._age > PATIENCE_ACTIONS and self.aim is not None:
            self._tried.append(self.aim)
            self.aim = None
        self._age += 1
        if self.aim is None:
            self._age = 0
        elif self._age % REFRESH_ACTIONS and floor.is_free(self.aim[:2]):
            return
        self.aim = self._best(floor, height_m, holding)

    def _best(self, floor: SeenFloor, height_m: float, holding: bool) -> Array:
        """Returns the place (3,) that promises most for its cost."""
        with torch.no_grad():
            seen = inputs(self.view(height_m, holding)).to(self._device)
            guess = self._network(seen)
            shares = guess.logits[0].flatten().softmax(0).reshape(SIDE, SIDE).cpu().numpy()
            aside_rad = guess.aside_rad[0].cpu().numpy()
        places_m = middle_m(self.map) + _OFFSETS_M  # (SIDE, SIDE, 2)
        free = floor.is_free(places_m)
        shares = np.where(free, shares, 0.0)
        for tried in self._tried:
            shares[np.linalg.norm(places_m - tried[:2], axis=-1) < EXCLUDED_M] = 0.0
        found = ndimage.convolve(shares, _DISC, mode="constant")
        ways_m = floor.geodesic_field(floor.nearest_free(self.map.pose[:2]))
        cells = floor.cells_of(places_m)
        cost_m = STOP_COST_M + ways_m[cells[..., 0], cells[..., 1]]
        worth = np.where(free, found / cost_m, -1.0)
        if self.aim is not None and floor.is_free(self.aim[:2]):
            x, y = np.floor((self.aim[:2] - middle_m(self.map)) / CELL_M).astype(int) + SIDE // 2
            if 0 <= x < SIDE and 0 <= y < SIDE:
                worth[x, y] *= KEEP_SHARE
        x, y = np.unravel_index(int(worth.argmax()), worth.shape)
        if worth[x, y] <= 0:  # nothing is left: from the beginning
            self._tried = self._tried[1:]
            place = floor.nearest_free(self.map.point_m)
            return np.array((*place, self._facing(place)))
        return np.array((*places_m[x, y], self._facing(places_m[x, y]) + aside_rad[x, y]))

    def _facing(self, place_m: Array) -> float:
        """Returns the yaw [rad] in which the base faces the point."""
        gap_m = self.map.point_m - place_m
        return math.atan2(gap_m[1], gap_m[0])


def goal_in_map(map_: RobotMap, start: Array, goal: Array) -> Array:
    """Returns a goal pose (3,) in a map's frame.

    Args:
        map_: The map.
        start: (3,) the first base pose, x, y [m] and yaw [rad].
        goal: (3,) the goal, likewise.
    """
    place = turned(np.asarray(goal[:2]) - np.asarray(start[:2]), -start[2])
    return np.array((*place, math.remainder(goal[2] - start[2], 2 * math.pi)))


_STEPS_M = (np.arange(SIDE) - (SIDE - 1) / 2) * CELL_M
_OFFSETS_M = np.stack(np.meshgrid(_STEPS_M, _STEPS_M, indexing="ij"), axis=-1)
_RADIUS = int(COVERED_M / CELL_M)
_STEPS = np.arange(-_RADIUS, _RADIUS + 1)
_DISC = ((_STEPS[:, None] ** 2 + _STEPS[None] ** 2) * CELL_M**2 <= COVERED_M**2).astype(float)
