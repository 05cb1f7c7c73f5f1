"""Place follower: an expert for Place in `ee`, by feedback alone.

The held object goes above its goal, down to it, and is released; the hand goes up and to rest. In
a cavity it goes in and out as Pick's hand does (`hab_experts.cavity`). The action depends on the
current state alone, so it can label the states that another policy visits.
"""

from __future__ import annotations

import numpy as np

from hab_experts.cavity import Cavity, Inside
from hab_experts.handle import hand_of, in_base, motion
from hab_tasks.constants import REST_POSITION_M
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.privileged import Array

ABOVE_M, CARRIED_M = 0.08, 1.0
"""The object comes at this height above the goal, or at this height, over other objects, while it
is far away."""

OVER_M, FAR_M = 0.03, 0.12
"""Horizontal distances from the goal: within the first, the object is lowered; beyond the second,
it is carried."""

RELEASE_M = 0.04
"""The hand opens when the object is so near to its goal."""

RELEASE_INSIDE_M = 0.09
"""The same in a cavity, where the hand does not come as near."""

ABOVE_INSIDE_M = 0.03
"""Height of the object above its goal on the way into a cavity."""

LIFT_M, AWAY_M = 0.05, 0.15
"""The empty hand rises by the first before it leaves, within the second distance of the goal."""


def place_motion(state: Snapshot, goal_m: Array, *, holds: bool, cavity: Cavity | None) -> Array:
    """Returns the ``ee`` action (4,) for one row.

    Args:
        state: The snapshot, of one row.
        goal_m: (3,) goal of the object's centre of mass, in the world.
        holds: Whether the object is held.
        cavity: The fridge or shelf that the goal is in; None otherwise.
    """
    hand_m, goal_m = hand_of(state), in_base(state, goal_m)
    inside = None if cavity is None else Inside.of(state, cavity)
    if not holds:
        return np.append(_back(hand_m, goal_m, inside), -1.0)
    object_m = in_base(state, np.asarray(state.objects_m[0, 0], dtype=float))
    gap_m = goal_m - object_m
    if inside is not None:
        grip = -1.0 if np.linalg.norm(gap_m) < RELEASE_INSIDE_M else 1.0
        above_m = goal_m + np.array((0.0, 0.0, ABOVE_INSIDE_M))
        return np.append(inside.way_in(object_m, above_m), grip)
    grip = -1.0 if np.linalg.norm(gap_m) < RELEASE_M else 1.0
    aside_m = np.linalg.norm(gap_m[:2])
    if aside_m > FAR_M:
        gap_m[2] = max(goal_m[2] + ABOVE_M, CARRIED_M) - object_m[2]
    elif aside_m > OVER_M:
        gap_m[2] += ABOVE_M
    return np.append(motion(gap_m), grip)


def _back(hand_m: Array, goal_m: Array, inside: Inside | None) -> Array:
    """Returns the motion (3,) of the empty hand: away from the object, and to rest."""
    if inside is not None:
        out = inside.way_out(hand_m)
        if out is not None:
            return out
    to_rest = motion(np.array(REST_POSITION_M) - hand_m)
    if np.linalg.norm(hand_m[:2] - goal_m[:2]) < AWAY_M and hand_m[2] < goal_m[2] + LIFT_M:
        to_rest[2] = 1.0
    return to_rest
