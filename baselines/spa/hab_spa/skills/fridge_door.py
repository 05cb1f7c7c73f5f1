"""The fridge's door seen from above: where its handle and faces are as it turns."""

from __future__ import annotations

import numpy as np

from hab_spa.shapes import Array
from hab_tasks.privileged import FrontState

HANDLE_OFF_FACE_M, HANDLE_TO_EDGE_M = 0.04, 0.08
"""So far the handle stands off the door's outer face, and so far its edge is beyond the handle."""


class Door:
    """A door that turns about an upright axis.

    A place beside it is given by two lengths: how far from the hinge along the door, and how far
    off its middle plane on the outer side, the one that looks into the room when it is closed.

    Attributes:
        joint: How far it is open now [rad].
        limits: How far it can be open.
        handle_m: (along, out) of its handle.
        edge_m: Distance of its edge from the hinge.
    """

    def __init__(self, front: FrontState) -> None:
        """Takes a door as it is now."""
        self._front, self.joint, self.limits = front, front.joint, front.limits
        yaw = front.frame[2]
        out = np.array((np.cos(yaw), np.sin(yaw)))
        turn = front.moved(0.0)[:2, :2]
        gap = turn @ (front.handle_m - front.axis_point_m)[:2]
        along = np.array((-out[1], out[0]))
        along *= np.sign(along @ gap)
        self._axes = np.stack((along, out))
        self.handle_m = self._axes @ gap
        self.edge_m = float(self.handle_m[0]) + HANDLE_TO_EDGE_M

    def point(self, joint: float, along_m: float, out_m: float) -> Array:
        """Returns the point (3,) in the world, as high as the handle, beside the door."""
        turn = self._front.moved(joint)[:2, :2] @ self._front.moved(0.0)[:2, :2].T
        place = turn @ (np.array((along_m, out_m)) @ self._axes)
        return np.append(self._front.axis_point_m[:2] + place, self._front.handle_m[2])

    def handle(self, joint: float) -> Array:
        """Returns where the handle (3,) is when the door is open so far."""
        return self.point(joint, *self.handle_m)

    def beside(self, points_m: Array, joint: float) -> Array:
        """Returns (along, out) (..., 2) of points (..., 2) in the world beside the door."""
        turn = self._front.moved(joint)[:2, :2] @ self._front.moved(0.0)[:2, :2].T
        gap = np.asarray(points_m)[..., :2] - self._front.axis_point_m[:2]
        return gap @ turn @ self._axes.T

    def gap_m(self, points_m: Array, joint: float) -> Array:
        """Returns how far points (..., 2) are from the door when it is open so far, (...)."""
        place = self.beside(points_m, joint)
        face_m = float(self.handle_m[1]) - HANDLE_OFF_FACE_M
        upper = np.array((self.edge_m, face_m))
        return np.linalg.norm(place - np.clip(place, 0.0, upper), axis=-1)

    def swept_m(self, points_m: Array, start: float, end: float, pad_m: float) -> float:
        """Returns how far the worst of points (P, 2) is inside of what the door sweeps.

        Args:
            points_m: In the world.
            start: From where it turns ...
            end: ... and how far.
            pad_m: Radius around each point.
        """
        angles = np.linspace(start, end, 8)
        gaps = np.stack([self.gap_m(points_m, float(angle)) for angle in angles])
        return float(np.maximum(pad_m - gaps, 0.0).max())
