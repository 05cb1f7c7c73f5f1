"""Motions of furniture over a floor with rugs."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from hab_authoring.layouts.overlaps import Bodies, extent, overlaps
from hab_tasks.privileged import Array
from hab_tasks.world.scenes.layout_geometry import PosedBody

SINK_M = 0.008
"""Maximum penetration of a piece into a rug."""


def planar(start_m: Array, end_m: Array, turn_rad: float) -> Array:
    """Returns the (4, 4) motion that turns about `start_m` (2,) and takes it to `end_m` (2,)."""
    cosine, sine = math.cos(turn_rad), math.sin(turn_rad)
    motion = np.eye(4)
    motion[:2, :2] = [[cosine, -sine], [sine, cosine]]
    motion[:2, 3] = end_m - motion[:2, :2] @ start_m
    return motion


def settled(own: Iterable[PosedBody], motion: Array, rugs: Bodies, sink_m: float = SINK_M) -> Array:
    """Adjusts the height of a motion (4, 4) so that a piece stands on the rug or floor below it.

    Args:
        own: The bodies of the piece at its old pose.
        motion: The motion to its new pose.
        rugs: Rugs and mats.
        sink_m: Maximum penetration into rugs.
    """
    own = tuple(own)
    low = min(extent(body).box_m[0, 2] for body in own)
    carrying = [
        flat
        for flat in _met(own, _lifted(np.eye(4), -sink_m), rugs)
        if abs(low - extent(flat).box_m[1, 2]) < sink_m
    ]
    lowered = -max((extent(flat).box_m[1, 2] for flat in carrying), default=0.0)
    met = _met(own, _lifted(motion, lowered), rugs)
    if any(flat in carrying for flat in met):
        return motion
    # Hulls of soft objects may extend below the floor; they are not lifted.
    bottom = max(low + lowered, 0.0)
    raised = max((extent(flat).box_m[1, 2] - sink_m - bottom for flat in met), default=0.0)
    return _lifted(motion, lowered + max(raised, 0.0))


def _met(own: Iterable[PosedBody], motion: Array, rugs: Bodies) -> list[PosedBody]:
    """Returns the rugs that a piece overlaps after a motion."""
    moved = Bodies(body.moved(motion) for body in own)
    return [flat for _, flat, _ in overlaps(moved, rugs)]


def _lifted(motion: Array, height_m: float) -> Array:
    """Returns a planar motion (4, 4) that also lifts."""
    lifted = motion.copy()
    lifted[2, 3] = height_m
    return lifted
