"""Drawer follower: an expert for the drawer in `ee`, by feedback alone.

The hand goes straight to the handle, moves it along the drawer's axis and returns to rest. The
action depends on the current state alone, so it can label the states that another policy visits.
"""

from __future__ import annotations

import numpy as np

from hab_experts.handle import hand_of, handle_at, in_base, to_handle, to_rest
from hab_tasks.articulations import DRAWER_CLOSED_M, DRAWER_OPEN_SHARE
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.privileged import Array, ArticulationState

GRASP_TO_OPEN_M, GRASP_TO_CLOSE_M = 0.07, 0.1
"""The hand closes within this distance of the handle. To close the drawer it comes from above, and
would push the front down if it came nearer."""

AHEAD_M = 0.14
"""The hand aims so far ahead of the handle: the grasp gives way, and a drawer that is stuck needs a
strong pull."""

ASIDE_M = 0.08
"""A hand that is so far from the drawer's axis first goes to the handle. Before a drawer's front,
it would otherwise meet the front from inside."""

LET_GO_OPEN_SHARE, OPEN_SHARE = DRAWER_OPEN_SHARE + 0.015, DRAWER_OPEN_SHARE + 0.005
LET_GO_CLOSED_M, CLOSED_M = DRAWER_CLOSED_M - 0.03, DRAWER_CLOSED_M - 0.01
"""A held drawer is let go beyond the first value; a free one is left alone beyond the second."""

BEFORE_M, IN_FRONT_M = 0.15, 0.04
"""To open a drawer, the hand first goes this far before its handle, until it is so near to the
drawer's axis: on a straight way it could meet the handle of another drawer."""

FELT_M = 0.03
"""A drawer is let go closed only when the hand is so far beyond the handle: a policy that does not
know the joint feels in this way that the drawer does not move any more."""


def drawer_motion(state: Snapshot, drawer: ArticulationState, *, opens: bool) -> Array:
    """Returns the ``ee`` action (4,) for one row.

    Args:
        state: The snapshot, of one row.
        drawer: The drawer.
        opens: Whether to open it, or to close it.
    """
    handle_m = in_base(state, drawer.handle_m)
    ahead = AHEAD_M if opens else -AHEAD_M
    pull_m = handle_at(state, drawer, drawer.joint + ahead) - handle_m
    axis, off_m = pull_m / AHEAD_M, hand_of(state) - handle_m
    beyond_m = float(off_m @ axis)
    if _is_done(drawer, opens, beyond_m):
        return to_rest(state)
    goal_m, aside_m = handle_m, float(np.linalg.norm(off_m - axis * beyond_m))
    if drawer.held:
        goal_m = handle_m + pull_m * np.clip(1 - aside_m / ASIDE_M, 0, 1)
    elif opens and aside_m > IN_FRONT_M:
        goal_m = handle_m + BEFORE_M * axis
    return to_handle(state, drawer, goal_m, GRASP_TO_OPEN_M if opens else GRASP_TO_CLOSE_M)


def _is_done(drawer: ArticulationState, opens: bool, beyond_m: float) -> bool:
    """Whether a drawer can be left alone, with the hand so far beyond its handle."""
    lower, upper = drawer.limits
    if opens:
        share = (drawer.joint - lower) / (upper - lower)
        return share > (LET_GO_OPEN_SHARE if drawer.held else OPEN_SHARE)
    if drawer.held:
        return drawer.joint < LET_GO_CLOSED_M and beyond_m > FELT_M
    return drawer.joint < CLOSED_M
