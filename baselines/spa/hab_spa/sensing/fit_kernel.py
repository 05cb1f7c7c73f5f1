"""How well a known shape fits depth images, compiled by numba; see `hab_spa.sensing.fridge_fit`."""

from __future__ import annotations

from math import cos, exp, isnan, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from hab_spa.planning.gjk import inlined
from hab_spa.planning.kernel import compiled
from hab_spa.shapes import Array

MOVES, FRONT, HANDLE = 1, 2, 4
"""Bits of `hab_spa.sensing.known_fridge.Outline.kind`."""

LEAST_COSINE, NEAREST_M, HANDLE_M = 0.1, 0.05, 0.1
THROUGH, THROUGH_COST, HIDDEN_COST = 3.0, 1.5, 0.8
"""A point through which the camera sees by so many tolerances, and one of a front that is hidden by
so many, cost as much as so many points that fit."""


@inlined
def _placed(
    point_m: Array, moves: bool, turn: tuple[float, float, float, float], at: tuple[float, float]
) -> tuple[float, float, float]:
    """Returns a point turned by the door's and then by the hinge's cosine and sine, and moved."""
    x, y = point_m[0], point_m[1]
    if moves:
        x, y = turn[2] * x - turn[3] * y, turn[3] * x + turn[2] * y
    return turn[0] * x - turn[1] * y + at[0], turn[1] * x + turn[0] * y + at[1], point_m[2]


@inlined
def _gap_m(
    point: tuple[float, float, float], normal: tuple[float, float, float], c: Array, image: Array
) -> float:
    """Returns how far behind a face a camera sees, along its normal; NaN if it shows no face."""
    qx = c[4] * point[0] + c[5] * point[1] + c[6] * point[2] + c[13]
    qy = c[7] * point[0] + c[8] * point[1] + c[9] * point[2] + c[14]
    qz = c[10] * point[0] + c[11] * point[1] + c[12] * point[2] + c[15]
    if qz < NEAREST_M:
        return np.nan
    along = qx * (c[4] * normal[0] + c[5] * normal[1] + c[6] * normal[2])
    along += qy * (c[7] * normal[0] + c[8] * normal[1] + c[9] * normal[2])
    along += qz * (c[10] * normal[0] + c[11] * normal[1] + c[12] * normal[2])
    cosine = -along / sqrt(qx * qx + qy * qy + qz * qz)
    column, row = qx / qz * c[0] + c[2], qy / qz * c[1] + c[3]
    inside = column >= 0 and row >= 0 and column < image.shape[1] and row < image.shape[0]
    if cosine < LEAST_COSINE or not inside:
        return np.nan
    return (image[int(row), int(column)] - qz) * cosine


@inlined
def _worth(gap_m: float, kind: int, tolerance_m: float) -> float:
    """Returns how much a point counts; nothing if it is out of view."""
    if isnan(gap_m):
        return 0.0
    if kind & HANDLE and -HANDLE_M < gap_m < 0.0:
        return 1.0
    if gap_m > THROUGH * tolerance_m:
        return -THROUGH_COST
    if gap_m > -THROUGH * tolerance_m:
        return exp(-((gap_m / tolerance_m) ** 2))
    return -HIDDEN_COST if kind & FRONT else 0.0


@compiled
def fit(
    points_m: Array, normals: Array, kind: NDArray[np.int64], hinges: Array, side: float,
    depth_m: Array, cameras: Array, tolerance_m: float, scores: Array,
) -> None:  # fmt: skip
    """Writes the scores (K,) of poses of a shape: points that fit, less those that do not.

    Args:
        points_m: (P, 3) on its faces, in the hinge's frame.
        normals: (P, 3) of the faces.
        kind: (P,) bits.
        hinges: (K, 4) poses of the hinge's frame, and openings.
        side: Sense in which the door turns.
        depth_m: (V, H, W) images; NaN where they show the robot.
        cameras: (V, 16) focal lengths, principal point, rotation and translation from the world.
        tolerance_m: Standard deviation of the distance of surfaces that are the same.
        scores: The scores.
    """
    for k in range(len(hinges)):
        yaw, turned = hinges[k, 2], -side * hinges[k, 3]
        turn, at = (cos(yaw), sin(yaw), cos(turned), sin(turned)), (hinges[k, 0], hinges[k, 1])
        total = 0.0
        for i in range(len(points_m)):
            moves = kind[i] & MOVES != 0
            point = _placed(points_m[i], moves, turn, at)
            normal = _placed(normals[i], moves, turn, (0.0, 0.0))
            for v in range(len(depth_m)):
                gap_m = _gap_m(point, normal, cameras[v], depth_m[v])
                total += _worth(gap_m, kind[i], tolerance_m)
        scores[k] = total
