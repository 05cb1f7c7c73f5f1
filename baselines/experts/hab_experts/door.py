"""Door follower: an expert for the fridge's door in `ee_base`, by feedback alone.

The hand goes straight to the handle, moves it along the door's arc and returns to rest, while the
base keeps its distance from the hand's target. The action depends on the current state alone, so
it can label the states that another policy visits.
"""

from __future__ import annotations

import math

import numpy as np

from hab_experts.handle import handle_at, to_handle, to_rest
from hab_tasks.articulations import FRIDGE, FRIDGE_OPEN_RAD, Rectangle
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.privileged import Array, ArticulationState

GRASP_M = 0.1
"""The hand closes within this distance of the handle."""

AHEAD_RAD = 0.15
"""The hand aims at the handle's place after this much motion of the door."""

LET_GO_OPEN_RAD, OPEN_RAD = FRIDGE_OPEN_RAD + 0.08, FRIDGE_OPEN_RAD + 0.03
LET_GO_CLOSED_RAD, CLOSED_RAD = 0.06, 0.12
"""A held door is let go beyond the first angle; a free one is left alone beyond the second."""

REACH_M, MOVE_M = 0.8, 0.65
"""Distance of the base from the handle while the hand is empty, and from its target otherwise."""

DRIVE_GAIN, MOST_DRIVE = 9.0, 0.6
TURN_GAIN, MOST_TURN = 1.43, 0.5
"""Shares of the base's speed per metre and radian, and the largest ones."""

DRIVE_WITHIN_RAD = 0.9
"""The base drives while its target is no farther aside."""

EDGE_X_M, EDGE_Y_M, LIMIT_Y_M = 0.12, 0.18, 0.12
"""Distances from the sides of the region: within the first along x, and the last along y, the base
drives away from the side; within the second along y, it turns straight."""

INWARD = 0.15
"""Share of the speed with which it drives away, so that a policy that imitates it has a margin."""

STRAIGHT_RAD, STRAIGHT_GAIN, MOST_STRAIGHT = 0.35, 2.86, 0.6


def door_motion(state: Snapshot, door: ArticulationState, *, opens: bool) -> Array:
    """Returns the ``ee_base`` action (6,) for one row.

    Args:
        state: The snapshot, of one row.
        door: The door.
        opens: Whether to open it, or to close it.
    """
    if _is_done(door, opens):
        return np.append(to_rest(state), (0.0, 0.0))
    ahead = np.clip(door.joint + (AHEAD_RAD if opens else -AHEAD_RAD), *door.limits)
    goal_m = handle_at(state, door, float(ahead) if door.held else door.joint)
    region = FRIDGE.opening_region if opens else FRIDGE.closing_region
    base = np.asarray(state.base[0], dtype=float)
    driven = _drive(base, goal_m, MOVE_M if door.held else REACH_M, door.frame, region)
    return np.append(to_handle(state, door, goal_m, GRASP_M), driven)


def _is_done(door: ArticulationState, opens: bool) -> bool:
    if opens:
        return door.joint > (LET_GO_OPEN_RAD if door.held else OPEN_RAD)
    return door.joint < (LET_GO_CLOSED_RAD if door.held else CLOSED_RAD)


def _drive(
    base: Array, goal_m: Array, distance_m: float, frame: Array, region: Rectangle
) -> tuple[float, float]:
    """Returns shares of forward and turning speed that keep a distance and face the goal.

    Args:
        base: (3,) x, y [m] and yaw [rad].
        goal_m: (3,) what to face, in the base frame.
        distance_m: Distance to keep from it.
        frame: (3,) of the furniture.
        region: Region in this frame that the base must not leave.
    """
    bearing = math.atan2(goal_m[1], goal_m[0])
    gap_m = math.hypot(goal_m[0], goal_m[1]) - distance_m
    forward = float(np.clip(DRIVE_GAIN * gap_m, -MOST_DRIVE, MOST_DRIVE))
    forward *= abs(bearing) < DRIVE_WITHIN_RAD
    turn = float(np.clip(TURN_GAIN * bearing, -MOST_TURN, MOST_TURN))
    cos, sin = math.cos(frame[2]), math.sin(frame[2])
    dx, dy = base[:2] - frame[:2]
    x, y = cos * dx + sin * dy, cos * dy - sin * dx
    heading = base[2] - frame[2]
    ahead, aside = math.cos(heading), math.sin(heading)
    if x > region.x_m[1] - EDGE_X_M and forward * ahead > -INWARD:
        forward = -INWARD * math.copysign(1, ahead)
    elif x < region.x_m[0] + EDGE_X_M and forward * ahead < INWARD:
        forward = INWARD * math.copysign(1, ahead)
    if abs(y) > region.y_m[1] - EDGE_Y_M and y * forward * aside > 0:
        straight = math.remainder(math.pi - heading, 2 * math.pi)
        turn = float(np.clip(STRAIGHT_GAIN * straight, -MOST_STRAIGHT, MOST_STRAIGHT))
        if abs(straight) > STRAIGHT_RAD and abs(y) > region.y_m[1] - LIMIT_Y_M:
            forward = -INWARD * math.copysign(1, forward)
    return forward, turn
