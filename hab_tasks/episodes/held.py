"""Start poses of an object in the hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.schema import template_of
from hab_tasks.errors import RejectedSampleError
from hab_tasks.geometry import Array
from hab_tasks.robots.spec import Fingers

PALM_GAP_M = 0.01
"""Distance of the object's top from the ends of the fingers at the palm."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Held:
    """Shape of an object that is to be held, in its own frame.

    Attributes:
        com_m: (3,) its centre of mass.
        up: (3,) its upright axis, one of that frame's.
        points_m: (P, 3) its corners.
    """

    com_m: Array
    up: Array
    points_m: Array

    @staticmethod
    def of(sandbox: PlacementSandbox, name: str) -> Held:
        """Returns the shape of an object in a sandbox."""
        return Held(
            com_m=sandbox.com_in_object_m(name),
            up=np.array(sandbox.templates[template_of(name)].up),
            points_m=sandbox.points_m(name),
        )


def in_fingers(held: Held, fingers: Fingers) -> Array:
    """Returns the pose (4, 4) of an object in the hand: its top at the palm, its narrow side held.

    Raises:
        RejectedSampleError: It is wider than the fingers span.
    """
    up, points_m = held.up, held.points_m
    low_m, high_m = points_m.min(axis=0), points_m.max(axis=0)
    level = [axis for axis in range(3) if abs(up[axis]) < 0.5]
    narrow = min(level, key=lambda axis: high_m[axis] - low_m[axis])
    if high_m[narrow] - low_m[narrow] > fingers.spans_m:
        raise RejectedSampleError("the object is too wide for the fingers")
    across = np.eye(3)[narrow]
    # The hand's x axis points from the palm to the fingertips, and the fingers close along y.
    hand_from_object = np.eye(4)
    hand_from_object[:3, :3] = np.stack((-up, across, np.cross(-up, across)))
    middle_m = hand_from_object[:3, :3] @ ((low_m + high_m) / 2)
    half_m = float(np.abs(up) @ (high_m - low_m)) / 2
    top_m = fingers.depth_m[0] + PALM_GAP_M
    hand_from_object[:3, 3] = np.array((top_m + half_m, 0.0, 0.0)) - middle_m
    return hand_from_object
