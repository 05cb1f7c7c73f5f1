"""Poses as seven numbers: position [m], then quaternion wxyz (SAPIEN's order).

Poses are named ``a_from_b``: they map coordinates in frame b to frame a.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from transforms3d import quaternions

Array = NDArray[np.float64]
Pose7 = tuple[float, float, float, float, float, float, float]

IDENTITY: Pose7 = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)

BOX_CORNERS = np.array(np.meshgrid((-1, 1), (-1, 1), (-1, 1))).reshape(3, 8).T
"""(8, 3) signs of the corners of a box."""

WORLD_FROM_HABITAT: Pose7 = (0.0, 0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
"""Rotation from Habitat's y-up data to the z-up world; applied once, on loading a scene."""


def pose(position_m: Array | tuple[float, ...], wxyz: Array | tuple[float, ...]) -> Pose7:
    """Returns a pose with its quaternion normalised."""
    q = np.asarray(wxyz, dtype=float)
    q = q / np.linalg.norm(q)
    return tuple(float(x) for x in (*position_m, *q))  # type: ignore[return-value]


def compose(a_from_b: Pose7, b_from_c: Pose7) -> Pose7:
    """Returns ``a_from_c``."""
    position = apply(a_from_b, np.asarray(b_from_c[:3]))
    return pose(position, quaternions.qmult(a_from_b[3:], b_from_c[3:]))


def apply(a_from_b: Pose7, points_m: Array) -> Array:
    """Maps points (3,) or (K, 3) from frame b to frame a."""
    rotation = quaternions.quat2mat(a_from_b[3:])
    return np.asarray(points_m) @ rotation.T + np.asarray(a_from_b[:3])


def inverse(a_from_b: Pose7) -> Pose7:
    """Returns ``b_from_a``."""
    conjugate = quaternions.qconjugate(a_from_b[3:])
    position = -quaternions.rotate_vector(a_from_b[:3], conjugate)
    return pose(position, conjugate)


def to_matrix(a_from_b: Pose7) -> Array:
    """Returns the pose as a (4, 4) matrix."""
    matrix = np.eye(4)
    matrix[:3, :3] = quaternions.quat2mat(a_from_b[3:])
    matrix[:3, 3] = a_from_b[:3]
    return matrix


def from_matrix(a_from_b: Array) -> Pose7:
    """Returns a (4, 4) rigid matrix as a pose."""
    return pose(a_from_b[:3, 3], quaternions.mat2quat(a_from_b[:3, :3]))


def planar(x_m: float, y_m: float, yaw_rad: float) -> Pose7:
    """Returns the pose of a frame on the floor, rotated by `yaw_rad` about z."""
    return pose((x_m, y_m, 0.0), (math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2)))


def rotation_between(a: Array, b: Array) -> tuple[float, float, float, float]:
    """Returns the shortest rotation (wxyz) that turns direction `a` (3,) into `b` (3,)."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    cosine = float(a @ b)
    if cosine < -1 + 1e-9:
        axis = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))])
        return tuple(quaternions.axangle2quat(axis, math.pi))
    q = np.array([1 + cosine, *np.cross(a, b)])
    return tuple(float(x) for x in q / np.linalg.norm(q))  # type: ignore[return-value]
