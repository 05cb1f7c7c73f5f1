"""Navigate with a map, a learned distribution of the goal pose, and shortest ways.

The robot drives to the place where a stop is worth most for the time that it takes. If a stop was
not at the goal, it excludes what the stop has tried, and goes on.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any, Literal

import numpy as np
import torch
from hab_experts.follower import ShortestPathFollower

from hab_navigator.belief import GoalBelief, NearSpace, Reach
from hab_navigator.network import GoalNetwork
from hab_navigator.robot_map import RobotMap, turned
from hab_navigator.seen_floor import SeenFloor
from hab_navigator.views import View, inputs
from hab_tasks.privileged import Array
from hab_tasks.robots.control_modes import BASE_CELLS, STOP_CELL
from hab_tasks.robots.spec import RobotSpec

REPEAT = 4
"""Steps for which each action is executed."""

SAME_M = 0.22
"""Places so near to each other count as the same."""

AT_PLACE_M = {"often": 1.0, "once": 20.0, "never": 1.0}
"""Time that turning at a place takes, as a way. With one stop, a likelier place is worth it."""

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

STUCK_ACTIONS, STUCK_M = 14, 0.12
"""In a task, a base that comes no farther than this in so many actions is stuck: its arm touches a
wall and springs back. The place is excluded, and it drives back ..."""

BACK_ACTIONS, BACK_CELL = 6, BASE_CELLS.index((-0.5, 0.0))
"""... for so many actions."""

KEEP_SHARE = 1.3
"""Another place has to be so much better than the one that the robot is driving to."""


Stops = Literal["often", "once", "never"]
"""When a navigator stops: on the way too, where that is worth it, as a stop that is not at the goal
costs no more than its time; only where it has arrived; or not at all, where arriving is enough."""


class Navigator:
    """Navigates in one episode.

    Attributes:
        map: The robot's map.
        aim: (3,) x, y [m] and yaw [rad] of the place it is driving to, in the map's frame.
    """

    def __init__(
        self,
        robot: RobotSpec,
        network: GoalNetwork,
        device: torch.device | str = "cpu",
        stops: Stops = "often",
        map_: RobotMap | None = None,
        reach: Reach | None = None,
    ) -> None:
        """Starts on the way to a point.

        Args:
            robot: The robot.
            network: The network.
            device: Its device.
            stops: When to stop.
            map_: Map of earlier ways, if there is one; then the base pose must be known.
            reach: Where the skill that follows can start; None for any pose.
        """
        self._turn_rad = REPEAT * robot.base_step_rad
        self.map = RobotMap(robot, REPEAT) if map_ is None else map_
        self.map.forget_point()
        self.aim: Array | None = None
        self._network, self._device, self._stops = network, device, stops
        self._reach = reach
        self._near: NearSpace | None = None  # for a hand that comes level only
        self._belief: GoalBelief | None = None
        self._worth, self._here = 0.0, 0.0  # of the aim; share of goals found by a stop here
        self._age, self._stopped = 0, False
        self._track, self._back = deque[Array](maxlen=STUCK_ACTIONS), 0

    def action(
        self, depth: Any, point_in_base_m: Array, holding: bool, base: Array | None = None
    ) -> int:
        """Returns the cell of ``base_discrete`` for the next `REPEAT` steps.

        Args:
            depth: (H, W, 1) depth image of the head camera as shares of its range.
            point_in_base_m: (3,) the point to go to.
            holding: Whether the hand holds something.
            base: (3,) pose of the base, if it is known; see `RobotMap.look`.
        """
        seen_m = self.map.look(depth, point_in_base_m, base)
        if self._reach is not None and self._reach.level:
            if self._near is None:
                self._near = NearSpace(np.append(self.map.point_m, point_in_base_m[2]))
            self._near.add(seen_m)
        floor = self._floor()
        if self._belief is None:
            self._belief = GoalBelief(self.map, self._reach)
        self._choose(self._belief, floor, self.view(float(point_in_base_m[2]), holding))
        assert self.aim is not None
        action = STOP_CELL
        if base is not None and self._backs_off(self._belief):
            action = BACK_CELL
        elif not self._stops_here(self._belief):
            follower = ShortestPathFollower(
                floor, self.aim, self._turn_rad, arrived_m=ARRIVED_M, arrived_rad=ARRIVED_RAD
            )
            action = follower.action(self.map.pose)
        self._stopped = action == STOP_CELL
        self.map.take(action)
        return action

    def _backs_off(self, belief: GoalBelief) -> bool:
        """Whether the base drives back, as it came no farther."""
        self._back = max(0, self._back - 1)
        if self._stopped or self._back:
            self._track.clear()
            return self._back > 0
        self._track.append(self.map.pose[:2].copy())
        come_m = np.linalg.norm(np.array(self._track) - self._track[-1], axis=1).max()
        if len(self._track) < STUCK_ACTIONS or come_m > STUCK_M:
            return False
        assert self.aim is not None
        belief.exclude(self.aim)
        self._back = BACK_ACTIONS
        return True

    def view(self, height_m: float, holding: bool) -> View:
        """Returns what the network sees now."""
        return View.of(self.map, height_m, holding)

    def _floor(self) -> SeenFloor:
        """Returns the floor; through gaps that look too narrow if there is no other way."""
        for radius_m in RADII_M:
            floor = SeenFloor(self.map, radius_m)
            reached_m = floor.nearest_free(self.map.point_m)
            if np.linalg.norm(reached_m - self.map.point_m) < REACHED_M:
                break
        return floor

    def _choose(self, belief: GoalBelief, floor: SeenFloor, view: View) -> None:
        """Chooses a place to drive to, or keeps the one there is."""
        self._age += 1
        looks = self.aim is None or self._age % REFRESH_ACTIONS == 0
        if self._stopped or self._stops == "never":
            belief.exclude(self.map.pose)
        if self._age > PATIENCE_ACTIONS and self.aim is not None:
            belief.exclude(self.aim)
            self._age = 0
        elif not (looks or self._stopped) and self.aim is not None and floor.is_free(self.aim[:2]):
            return
        if looks:
            belief.learn(self._distribution(view))
            if self._near is not None:
                belief.see(self._near.clearances_m())
        before, self.aim = self.aim, self._best(belief, floor)
        if before is None or np.linalg.norm(self.aim[:2] - before[:2]) > SAME_M:
            self._age = 0

    def _best(self, belief: GoalBelief, floor: SeenFloor) -> Array:
        """Returns the pose (3,) that promises most for its cost."""
        free = floor.is_free(belief.places_m)
        belief.update(free)
        worth = np.where(free, belief.found / self._cost_m(floor, belief.places_m), -1.0)
        cell = None if self.aim is None else belief.cell_of(self.aim)
        if cell is not None:
            worth[:, cell[0], cell[1]] *= KEEP_SHARE
        best = np.unravel_index(int(worth.argmax()), worth.shape)
        self._worth = float(worth[best])
        if self._worth > 0.0:
            return np.array((*belief.places_m[best[1:]], belief.yaws_rad[best]))
        belief.forgive()  # nothing is left: from the beginning
        place = floor.nearest_free(self.map.point_m)
        ahead_m = self.map.point_m - place
        return np.array((*place, math.atan2(ahead_m[1], ahead_m[0])))

    @torch.no_grad()
    def _distribution(self, view: View) -> Array:
        """Returns the network's distribution of the goal pose (HEADINGS, SIDE, SIDE)."""
        logits = self._network(inputs(view).to(self._device))
        return logits[0].flatten().softmax(0).reshape(logits[0].shape).cpu().numpy()

    def _stops_here(self, belief: GoalBelief) -> bool:
        """Whether a stop on the way finds more goals for its time than the place ahead."""
        found, before = belief.found_at(self.map.pose), self._here
        self._here = found
        if self._stops != "often" or self._stopped:
            return False
        return MORE_AHEAD * before > found > max(LEAST_SHARE, STOP_M * self._worth)

    def _cost_m(self, floor: SeenFloor, places_m: Array) -> Array:
        """Returns the cost of going to places (SIDE, SIDE, 2) and of turning there."""
        ways_m = floor.geodesic_field(floor.nearest_free(self.map.pose[:2]))
        cells = floor.cells_of(places_m)
        return AT_PLACE_M[self._stops] + ways_m[cells[..., 0], cells[..., 1]]


def goal_in_map(start: Array, goal: Array) -> Array:
    """Returns a goal pose (3,) in the frame of a map.

    Args:
        start: (3,) the first base pose, x, y [m] and yaw [rad].
        goal: (3,) the goal, likewise.
    """
    place = turned(np.asarray(goal[:2]) - np.asarray(start[:2]), -start[2])
    return np.array((*place, math.remainder(goal[2] - start[2], 2 * math.pi)))
