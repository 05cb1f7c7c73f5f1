"""Planar geometry of the fridge door: positions of handle and faces as a function of the joint."""

from __future__ import annotations

import numpy as np

from hab_spa.shapes import Array
from hab_tasks.privileged import ArticulationState

HANDLE_OFF_FACE_M, HANDLE_TO_EDGE_M = 0.04, 0.08
"""Distance of the handle from the door's outer face, and of the door's edge from the handle."""


class Door:
    """A door with a vertical axis.

    Points in the door's frame have two coordinates: along the door from the hinge, and out of its
    middle plane on the outer side, which faces the room when the door is closed.

    Attributes:
        joint: Current opening [rad].
        limits: Joint limits [rad].
        handle_m: (along, out) of the handle.
        edge_m: Distance of the edge from the hinge.
    """

    def __init__(self, articulation: ArticulationState) -> None:
        """Reads the door's current state."""
        self._articulation, self.joint, self.limits = (
            articulation,
            articulation.joint,
            articulation.limits,
        )
        yaw = articulation.frame[2]
        out = np.array((np.cos(yaw), np.sin(yaw)))
        turn = articulation.moved(0.0)[:2, :2]
        gap = turn @ (articulation.handle_m - articulation.axis_point_m)[:2]
        along = np.array((-out[1], out[0]))
        along *= np.sign(along @ gap)
        self._axes = np.stack((along, out))
        self._turns: dict[float, Array] = {}
        self.handle_m = self._axes @ gap
        self.edge_m = float(self.handle_m[0]) + HANDLE_TO_EDGE_M

    def point(self, joint: float, along_m: float, out_m: float) -> Array:
        """Returns the world point (3,), at the handle's height, of a point in the door's frame."""
        return self.points(joint, np.array(((along_m, out_m),)))[0]

    def points(self, joint: float, positions_m: Array) -> Array:
        """Returns the world points (P, 3) of points (P, 2) in the door's frame; see `point`."""
        points_m = np.empty((len(positions_m), 3))
        points_m[:, :2] = self._articulation.axis_point_m[:2]
        points_m[:, :2] += positions_m @ self._axes @ self._turn(joint).T
        points_m[:, 2] = self._articulation.handle_m[2]
        return points_m

    def handle(self, joint: float) -> Array:
        """Returns the handle's position (3,) for a joint position."""
        return self.point(joint, *self.handle_m)

    def beside(self, points_m: Array, joint: float) -> Array:
        """Returns world points (..., 2) in the door's frame, as (along, out) (..., 2)."""
        gap = np.asarray(points_m)[..., :2] - self._articulation.axis_point_m[:2]
        return gap @ self._turn(joint) @ self._axes.T

    def _turn(self, joint: float) -> Array:
        """Returns the rotation (2, 2) from the closed door; searches ask for few joints, often."""
        if joint not in self._turns:
            turn, closed = (self._articulation.moved(j)[:2, :2] for j in (joint, 0.0))
            self._turns[joint] = turn @ closed.T
        return self._turns[joint]

    def gap_m(self, points_m: Array, joint: float) -> Array:
        """Returns the distances (...) of points (..., 2) from the door for a joint position."""
        local = self.beside(points_m, joint)
        face_m = float(self.handle_m[1]) - HANDLE_OFF_FACE_M
        upper = np.array((self.edge_m, face_m))
        return np.linalg.norm(local - np.clip(local, 0.0, upper), axis=-1)

    def swept_m(self, points_m: Array, start: float, end: float, pad_m: float) -> float:
        """Returns the maximum penetration of points (P, 2) into the door's swept area.

        Args:
            points_m: World points.
            start: Initial joint position [rad].
            end: Final joint position [rad].
            pad_m: Radius around each point.
        """
        angles = np.linspace(start, end, 8)
        gaps = np.stack([self.gap_m(points_m, float(angle)) for angle in angles])
        return float(np.maximum(pad_m - gaps, 0.0).max())
