"""Shortest-path follower: an expert for Navigate's discrete actions, as in Habitat."""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from hab_tasks.privileged import Array
from hab_tasks.robots.control_modes import BASE_CELLS, STOP_CELL
from hab_tasks.world.navigation import descend

AHEAD_CELLS = 8
"""The follower aims at the point of its path so many cells (of 5 cm) ahead."""

ARRIVED_M = 0.2
ARRIVED_RAD = 0.35
"""The follower stops so near to the goal pose, well within what Navigate asks for (S H.2). A policy
that imitates it does not observe the goal pose, and rarely gets nearer."""

TURN_FIRST_RAD = 0.5
"""The base turns in place while the point ahead is farther to the side."""

SLOW_RAD = 0.2
SLOW_M = 0.3
"""The base drives at half speed while the point ahead is so far aside, or the goal so near."""

NEAR_M, BESIDE_M = 0.9, 0.6
"""A goal so near, and no farther to the side of its heading, is approached facing its heading."""

ASIDE_RAD, FACED_ASIDE_RAD = 0.8, 1.2
"""There, the base drives backwards until the goal is so nearly ahead of its heading; if the base
points to the goal, the second is enough. It then turns little at the goal, and a policy that
imitates it keeps looking at what it will have to do with."""

_TURNS = (-1.0, -0.5, 0.0, 0.5, 1.0)


class FloorMap(Protocol):
    """What a follower needs of a map, such as `NavigationMap`."""

    def cells_of(self, points_m: Array) -> NDArray[Any]:
        """Returns the cells (..., 2) of points (..., 2)."""
        ...

    def positions(self, cells: NDArray[Any]) -> Array:
        """Returns the positions (..., 2) of cells (..., 2)."""
        ...

    def nearest_free(self, points_m: Array) -> Array:
        """Returns the free position (2,) nearest to a point (2,)."""
        ...

    def clear(self, start_m: Array, end_m: Array) -> bool:
        """Whether the straight line between two points (2,) is free."""
        ...

    def geodesic_field(self, goals_m: Array) -> Array:
        """Returns the way [m] from every cell (X, Y) to a free position (2,)."""
        ...


class ShortestPathFollower:
    """Drives along the shortest path to a goal pose, turns to its heading, and stops.

    Its action depends on the base pose alone, so it can label the states that another policy
    visits.
    """

    def __init__(
        self,
        map_: FloorMap,
        goal: Array,
        turn_rad: float,
        *,
        arrived_m: float = ARRIVED_M,
        arrived_rad: float = ARRIVED_RAD,
    ) -> None:
        """Follows paths on a map to a goal (3,): x, y [m] and yaw [rad].

        `turn_rad` is what an action turns the base at full speed.
        """
        self._arrived_m, self._arrived_rad = arrived_m, arrived_rad
        self._map, self._goal, self._turn_rad = map_, goal, turn_rad
        self._end_m = map_.nearest_free(self._goal[:2])
        self._field = map_.geodesic_field(self._end_m)

    def action(self, base: Array) -> int:
        """Returns the cell of ``base_discrete`` for a base pose (3,): x, y [m] and yaw [rad]."""
        here, yaw = base[:2], float(base[2])
        gap_m = float(np.linalg.norm(self._end_m - here))
        if gap_m < self._arrived_m:
            turn = angle_between(self._goal[2], yaw)
            return STOP_CELL if abs(turn) < self._arrived_rad else self._cell(0.0, turn)
        direct = self._map.clear(here, self._end_m)
        ahead = (self._end_m if direct else self._ahead_m(here)) - here
        turn = angle_between(math.atan2(ahead[1], ahead[0]), yaw)
        limit_rad = ASIDE_RAD if abs(turn) > TURN_FIRST_RAD else FACED_ASIDE_RAD
        if direct and gap_m < NEAR_M and self._backs(here, limit_rad):
            turn = angle_between(self._goal[2], yaw)
            return self._cell(-0.5 if abs(turn) < TURN_FIRST_RAD else 0.0, turn)
        if abs(turn) > (SLOW_RAD if gap_m < NEAR_M else TURN_FIRST_RAD):
            return self._cell(0.0, turn)
        return self._cell(0.5 if abs(turn) > SLOW_RAD or gap_m < SLOW_M else 1.0, turn)

    def _backs(self, here: Array, limit_rad: float) -> bool:
        """Returns whether to drive backwards: the goal is farther aside of its heading."""
        heading = np.array((math.cos(self._goal[2]), math.sin(self._goal[2])))
        gap = self._end_m - here
        ahead, aside = float(heading @ gap), float(heading[0] * gap[1] - heading[1] * gap[0])
        if abs(aside) > BESIDE_M or abs(math.atan2(aside, ahead)) < limit_rad:
            return False
        back_m = abs(aside) / math.tan(ASIDE_RAD) - ahead
        return self._map.clear(here, here - back_m * heading)

    def _cell(self, forward: float, turn_rad: float) -> int:
        """Returns the cell with a forward share and the turning share that turns by an angle."""
        share = min(_TURNS, key=lambda share: abs(turn_rad - share * self._turn_rad))
        return BASE_CELLS.index((forward, share))

    def _ahead_m(self, here: Array) -> Array:
        """Returns the point (2,) of the path to aim at where the goal is not in a straight line."""
        start = self._map.nearest_free(here)
        cells = descend(self._field, self._map.cells_of(start), AHEAD_CELLS)
        return self._map.positions(cells[-1]) if len(cells) else self._end_m


def angle_between(to_rad: float, from_rad: float) -> float:
    """Returns the turn in [-pi, pi] from one heading to another."""
    return math.remainder(to_rad - from_rad, 2 * math.pi)
