"""What the experts of doors and drawers share: the hand at a handle, by feedback alone."""

from __future__ import annotations

import numpy as np

from hab_tasks.constants import EE_STEP_M, REST_POSITION_M
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.privileged import Array, ArticulationState


def hand_of(state: Snapshot) -> Array:
    """Returns the end-effector (3,) of the first row in the base frame."""
    return np.asarray(state.ee_in_base_m[0], dtype=float)


def in_base(state: Snapshot, point_m: Array) -> Array:
    """Returns a world point (3,) in the base frame of the first row."""
    axes = np.asarray(state.base_axes[0], dtype=float)
    gap_m = point_m - np.asarray(state.ee_m[0], dtype=float)
    return hand_of(state) + axes.T @ gap_m


def handle_at(state: Snapshot, articulation: ArticulationState, joint: float) -> Array:
    """Returns where the handle (3,) is at a joint position, in the base frame."""
    moved = articulation.moved(joint)
    return in_base(state, moved[:3, :3] @ articulation.handle_m + moved[:3, 3])


def motion(gap_m: Array) -> Array:
    """Returns the shares (3,) of a step that lead over a gap (3,), each axis at its own speed."""
    return np.clip(gap_m / EE_STEP_M, -1, 1)


def straight(gap_m: Array) -> Array:
    """Returns the shares (3,) of a step along a gap (3,)."""
    return gap_m / max(float(np.abs(gap_m).max()), EE_STEP_M)


def to_rest(state: Snapshot) -> Array:
    """Returns the action (4,) that brings the empty hand to rest."""
    return np.append(motion(np.array(REST_POSITION_M) - hand_of(state)), -1.0)


def to_handle(
    state: Snapshot, articulation: ArticulationState, goal_m: Array, grasp_m: float
) -> Array:
    """Returns the action (4,) that brings the hand to a point, and grasps the handle on the way.

    Args:
        state: The snapshot, of one row.
        articulation: The door or drawer.
        goal_m: (3,) the point, in the base frame.
        grasp_m: The hand closes within this distance of the handle.
    """
    handle_m = in_base(state, articulation.handle_m)
    near = np.linalg.norm(handle_m - hand_of(state)) < grasp_m
    grip = 1.0 if articulation.held or near else -1.0
    return np.append(motion(goal_m - hand_of(state)), grip)
