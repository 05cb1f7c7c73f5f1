"""Pick follower: an expert for Pick in `ee`, by feedback alone.

The hand goes straight to the object and lifts it on the way back. In the fridge and on shelves,
where a straight way would meet a board, it first comes to the object's height before the opening,
then goes in and out along its axis. The action depends on the current state alone, so it can label
the states that another policy visits.
"""

from __future__ import annotations

import numpy as np

from hab_experts.cavity import Cavity, Inside
from hab_experts.handle import hand_of, in_base, motion
from hab_tasks.constants import GRASP_RADIUS_M, REST_POSITION_M
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.privileged import Array

GRASP_M = 0.09
"""The hand closes within this distance of the object; in a cavity, as soon as it can grasp."""

LIFT_M = 0.1
"""Height above the resting position at which the object returns, to clear edges."""

ABOVE_M = 0.05
"""Height of the hand above the object's centre in a cavity."""


def pick_motion(state: Snapshot, *, holds: bool, nearest: bool, cavity: Cavity | None) -> Array:
    """Returns the ``ee`` action (4,) for one row.

    Args:
        state: The snapshot, of one row.
        holds: Whether the target is held.
        nearest: Whether no other object is nearer to the hand than the target.
        cavity: The fridge or shelf that the target is in; None otherwise.
    """
    hand_m = hand_of(state)
    target_m = in_base(state, np.asarray(state.objects_m[0, 0], dtype=float))
    inside = None if cavity is None else Inside.of(state, cavity)
    if holds:
        return np.append(_back(hand_m, inside), 1.0)
    reach_m = GRASP_M if inside is None else GRASP_RADIUS_M
    grasps = nearest and np.linalg.norm(target_m - hand_m) < reach_m
    moved = (
        motion(target_m - hand_m)
        if inside is None
        else inside.way_in(hand_m, target_m + np.array((0.0, 0.0, ABOVE_M)))
    )
    return np.append(moved, 1.0 if grasps else -1.0)


def _back(hand_m: Array, inside: Inside | None) -> Array:
    """Returns the motion (3,) of a hand that holds the object: out, and to rest."""
    out = None if inside is None else inside.way_out(hand_m)
    if out is not None:
        return out
    return motion(np.array(REST_POSITION_M) + np.array((0.0, 0.0, LIFT_M)) - hand_m)
