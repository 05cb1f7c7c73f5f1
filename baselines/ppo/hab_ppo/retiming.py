"""Retiming of a hand's path into the ``ee`` control mode, at most 1.5 cm a step.

The path of any agent, whatever its control mode, becomes a list of stretches between changes of
the gripper. A follower moves from point to point by the observed position of the end-effector, so
it also returns to the path from beside it: it labels disturbed states with what is right there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hab_tasks.constants import EE_STEP_M
from hab_tasks.robots.spec import RobotSpec

Array = NDArray[np.float64]

AHEAD = np.array((1.0, 0.0, 0.0))

SPACING_M = 0.01
"""Distance between the points of a stretch."""

PASSED_M = 0.04
"""A point is passed within this distance. With less, a small deviation from the path would change
the direction to its next point by much, and the label could hardly be learnt."""

REACHED_M = 0.01
"""The end of a stretch is reached within this distance."""

GRASPED_M = 0.04
"""The same before a grasp on a straight path: well within the snap grasp, and easier to learn."""

ROOM_M = 0.04
"""Distance from the near side of the workspace, beyond which the controller keeps the hand, that
the hand keeps while it holds something and the base can drive."""

PULL_SPACING_M = 0.022
"""Distance between the points while the base drives back: one is passed in every step."""

LAST_GAIN = 0.5
"""Share of the distance to the end of a stretch that an action covers: the hand follows its
commands with a delay of some steps, and would overshoot with more."""

PROGRESS_M, PATIENCE_STEPS = 0.001, 8
"""A point that comes no nearer by this in so many steps is taken as reached."""

SHIFT_LOW_M, SHIFT_HIGH_M = (-0.15, -0.03, -0.02), (0.0, 0.03, 0.1)
"""Range of the shift of a varied path: towards the robot and up, where there is less to touch."""

EARLY_M = (0.02, 0.13)
"""Range of the distance at which a varied path grasps."""

RAMP_M = 0.1
"""Length over which a shift sets in."""

GRASP_STEPS = 12
"""Most steps for the gripper to take hold or let go."""


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """A part of a path with one value of the gripper, while the base stands or while it drives.

    Attributes:
        points_m: (P, 3) points of the end-effector in the base frame.
        gripper: 1 grasps, -1 releases.
        drives: (P, 2) base entries of the action, one for each step; None while the base stands.
        end_m: (3,) where the stretch leads; None for its last point.
        reached_m: The end is reached within this distance.
    """

    points_m: Array
    gripper: float
    drives: Array | None = None
    end_m: Array | None = None
    reached_m: float = REACHED_M

    @property
    def goal_m(self) -> Array:
        """Where the stretch leads, (3,)."""
        return self.points_m[-1] if self.end_m is None else self.end_m


class Recorded(NamedTuple):
    """What an agent did in T steps.

    Attributes:
        points_m: (T + 1, 3) end-effector in the base frame, before and after each step.
        grippers: (T,) the gripper's entry of the actions.
        drives: (T, 2) the base's entries; zero where the base cannot move.
    """

    points_m: Array
    grippers: Array
    drives: Array


def stretches(recorded: Recorded) -> list[Stretch]:
    """Returns a path in stretches; steps in which the hand hardly moves take no time.

    While the base drives, every step is kept, as its motion has no feedback.
    """
    signs = np.where(recorded.grippers >= 0, 1.0, -1.0)
    driving = np.abs(recorded.drives).max(axis=1) > 0
    changes = (np.diff(signs) != 0) | np.diff(driving)
    bounds = [0, *(np.flatnonzero(changes) + 1).tolist(), len(signs)]
    found = []
    for first, end in pairwise(bounds):
        gripper = float(signs[first])
        if driving[first]:
            points, drives = recorded.points_m[first + 1 : end + 1], recorded.drives[first:end]
            found.append(Stretch(points_m=points, gripper=gripper, drives=drives))
        else:
            points = spaced(recorded.points_m[first : end + 1])
            found.append(Stretch(points_m=points, gripper=gripper))
    return found


def within_workspace(path: list[Stretch], robot: RobotSpec) -> list[Stretch]:
    """Returns a path on which the base drives back where it pulls the hand too near to the base.

    An agent that sets joints can reach points that the ``ee`` controller does not. All points after
    the base has driven back lie farther ahead by as much, but for the end of the path, where the
    hand rests.
    """
    result, back_m, nearest_m = [], 0.0, robot.ee_lower_m[0] + ROOM_M
    for number, stretch in enumerate(path):
        points = stretch.points_m + back_m * AHEAD
        if number == len(path) - 1 and stretch.gripper < 0:
            points = points - np.linspace(0, back_m, len(points))[:, None] * AHEAD
        if stretch.gripper < 0 or stretch.drives is not None or points[:, 0].min() > nearest_m:
            result.append(replace(stretch, points_m=points))
            continue
        standing = int(np.argmax(points[:, 0] <= nearest_m))
        if standing:
            result.append(replace(stretch, points_m=points[:standing]))
        pulled = spaced(points[max(0, standing - 1) :], PULL_SPACING_M)
        pulled_back_m = np.maximum.accumulate(np.maximum(0.0, nearest_m - pulled[:, 0]))
        drives = np.zeros((len(pulled), 2))
        drives[:, 0] = np.clip(-np.diff(pulled_back_m, prepend=0.0) / robot.base_step_m, -1, 1)
        moved = pulled + pulled_back_m[:, None] * AHEAD
        result.append(replace(stretch, points_m=moved, drives=drives))
        back_m += float(pulled_back_m[-1])
    return result


def spaced(points_m: Array, spacing_m: float = SPACING_M) -> Array:
    """Returns points (P, 3), so far apart along a line of points (T, 3), to its end."""
    lengths = np.linalg.norm(np.diff(points_m, axis=0), axis=1)
    along = np.concatenate(([0.0], np.cumsum(lengths)))
    count = max(1, int(np.ceil(along[-1] / spacing_m)))
    wanted = np.linspace(0.0, along[-1], count + 1)[1:]
    return np.stack([np.interp(wanted, along, axis) for axis in points_m.T], axis=1)


def straight(path: list[Stretch]) -> list[Stretch]:
    """Returns a path that goes straight where the hand is empty and the base stands.

    Planned paths have detours by chance, which nobody can learn from what the policy observes.
    """
    result = []
    for number, stretch in enumerate(path):
        grasps = number + 1 < len(path) and path[number + 1].gripper > 0
        if stretch.gripper > 0 or stretch.drives is not None:
            result.append(stretch)
            continue
        ends_m = stretch.points_m[[0, -1]]
        reached_m = GRASPED_M if grasps else REACHED_M
        result.append(replace(stretch, points_m=spaced(ends_m), reached_m=reached_m))
    return result


def varied(path: list[Stretch], drawn: np.random.Generator) -> list[Stretch]:
    """Returns a path whose ways to a grasp are shifted and end sooner, within the snap grasp.

    The hand that follows turns as the ``ee`` controller's inverse kinematics has it, and can touch
    what the agent's hand did not.
    """
    result = []
    for number, stretch in enumerate(path):
        grasps = number + 1 < len(path) and stretch.gripper < 0 < path[number + 1].gripper
        shift_m = drawn.uniform(SHIFT_LOW_M, SHIFT_HIGH_M) if stretch.gripper < 0 else np.zeros(3)
        reached_m = float(drawn.uniform(*EARLY_M))
        if stretch.drives is not None or not shift_m.any():
            result.append(stretch)
        elif grasps:
            shifted = stretch.points_m + _ramp(len(stretch.points_m))[:, None] * shift_m
            end_m = stretch.points_m[-1]
            changed = replace(stretch, points_m=shifted, end_m=end_m, reached_m=reached_m)
            result.append(changed)
        else:
            both = np.minimum(_ramp(len(stretch.points_m)), _ramp(len(stretch.points_m))[::-1])
            result.append(replace(stretch, points_m=stretch.points_m + both[:, None] * shift_m))
    return result


def _ramp(count: int) -> Array:
    """Returns how much of a shift `count` points have, (count,), from 0 to 1."""
    return np.minimum(1.0, np.arange(count) * SPACING_M / RAMP_M)


class Follower:
    """Follows a path by the observed position of the end-effector.

    Attributes:
        finished: Whether the end of the path has been reached.
    """

    def __init__(self, path: list[Stretch]) -> None:
        self._path = path
        self._stretch = self._point = 0
        self._waited_steps = 0
        self._expect_nearer()
        self.finished = False
        self._empty_steps = 0

    @property
    def has_lost(self) -> bool:
        """Whether the hand has not held for long what it should hold here."""
        return self._empty_steps > GRASP_STEPS

    def act(self, ee_m: Array, holding: bool) -> Array:
        """Returns the action (6,): motion in units of 1.5 cm, gripper, base.

        Args:
            ee_m: (3,) end-effector in the base frame.
            holding: Whether the gripper holds anything.
        """
        stretch = self._path[self._stretch]
        action = np.zeros(6)
        action[3] = stretch.gripper
        self._empty_steps = self._empty_steps + 1 if stretch.gripper > 0 and not holding else 0
        if stretch.drives is not None:
            action[:3] = motion(stretch.points_m[self._point] - ee_m, last=True)
            action[4:] = stretch.drives[self._point]
            self._pass()
            return action
        if self._grips(stretch, holding):
            return action
        if np.linalg.norm(stretch.goal_m - ee_m) < stretch.reached_m:
            self._end()
            return action if self.finished else self.act(ee_m, holding)
        last = len(stretch.points_m) - 1
        while self._point < last and self._passed(stretch.points_m, ee_m):
            self._pass()
        gap_m = stretch.points_m[self._point] - ee_m
        if self._stalled(gap_m):
            self._pass()
        action[:3] = motion(gap_m, last=self._point == last)
        return action

    def _grips(self, stretch: Stretch, holding: bool) -> bool:
        """Whether the hand stands still for the gripper, at the start of a stretch."""
        before = self._path[self._stretch - 1].gripper if self._stretch else stretch.gripper
        begins = self._point == 0 and before != stretch.gripper
        if not begins or self._waited_steps >= GRASP_STEPS:
            return False
        if self._waited_steps and holding == (stretch.gripper > 0):
            return False
        self._waited_steps += 1
        return True

    def _passed(self, points_m: Array, ee_m: Array) -> bool:
        """Whether the hand is at the current point, or nearer to the next one."""
        here, following = np.linalg.norm(points_m[self._point : self._point + 2] - ee_m, axis=1)
        return bool(here < PASSED_M or following < here)

    def _stalled(self, gap_m: Array) -> bool:
        """Counts the steps since the hand last came nearer to the current point."""
        distance_m = float(np.linalg.norm(gap_m))
        if distance_m < self._nearest_m - PROGRESS_M:
            self._nearest_m, self._still_steps = distance_m, 0
        else:
            self._still_steps += 1
        return self._still_steps >= PATIENCE_STEPS

    def _pass(self) -> None:
        """Goes on to the next point, or stretch."""
        self._point += 1
        self._expect_nearer()
        if self._point == len(self._path[self._stretch].points_m):
            self._end()

    def _end(self) -> None:
        """Goes on to the next stretch; after the last one, its last point stays."""
        self._expect_nearer()
        if self._stretch + 1 == len(self._path):
            self._point = len(self._path[self._stretch].points_m) - 1
            self.finished = True
            return
        self._stretch, self._point, self._waited_steps = self._stretch + 1, 0, 0

    def _expect_nearer(self) -> None:
        self._nearest_m, self._still_steps = float("inf"), 0


def motion(gap_m: Array, *, last: bool) -> Array:
    """Returns the arm entries (3,) that move the hand along a gap (3,); at most 1 each.

    Args:
        gap_m: Vector to a point.
        last: Whether to slow down before it.
    """
    steps = gap_m / EE_STEP_M * (LAST_GAIN if last else 1.0)
    largest = float(np.abs(steps).max())
    if last:
        return steps / max(1.0, largest)
    return steps / max(1e-9, largest)
