"""Antipodal grasps of an object's shape by two parallel fingers.

A grasp is a pose of the hand at which the fingers press on two opposite points of the surface, each
within the cone of friction. Nothing of the object is where the open hand comes in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from hab_spa.shapes import Array, shape_bounds_m
from hab_tasks.arrays import Bools
from hab_tasks.privileged import CollisionBody, CollisionShape
from hab_tasks.robots.spec import Fingers

Indices = NDArray[np.intp]


@dataclass(frozen=True, kw_only=True)
class AntipodalConfig:
    """Parameters of the sampler.

    Attributes:
        points: Number of points on the surface.
        cone_rad: Largest angle between a finger's force and the surface's normal.
        clearance_m: Least distance of the open fingers from the object.
        turns: Number of directions from which the hand comes to each pair of points.
        depths_m: Where the points are along the fingers, from the middle of the pads.
        pairs: Maximum number of pairs of points.
        palm_m: Lower and upper corner of the palm in the hand's frame.
        finger_half_width_m, finger_thickness_m: Size of a finger.
    """

    points: int = 800
    cone_rad: float = 0.35
    clearance_m: float = 0.004
    turns: int = 16
    depths_m: tuple[float, ...] = (0.012, 0.0, -0.012)
    pairs: int = 300
    palm_m: tuple[tuple[float, float, float], tuple[float, float, float]] = (
        (-0.154, -0.065, -0.042),
        (-0.03, 0.065, 0.042),
    )
    finger_half_width_m: float = 0.014
    finger_thickness_m: float = 0.015


@lru_cache(maxsize=64)
def antipodal_grasps(
    body: CollisionBody, fingers: Fingers, seed: int, config: AntipodalConfig
) -> Array:
    """Returns grasps (G, 4, 4): poses of the hand in the body's frame, in random order.

    The hand's x axis points from the palm to the fingertips; the fingers close along y.
    """
    rng = np.random.default_rng(seed)
    points_m, normals = surface(body.shapes, config.points, rng)
    first, second = _opposite(points_m, normals, fingers, config)
    if not len(first):
        return np.zeros((0, 4, 4))
    order = rng.permutation(len(first))[: config.pairs]
    first, second = first[order], second[order]
    closing = points_m[second] - points_m[first]
    closing /= np.linalg.norm(closing, axis=1, keepdims=True)
    middle_m = (points_m[first] + points_m[second]) / 2
    turns = rng.uniform(0.0, 2 * np.pi, len(first))
    found = []
    for turn in range(config.turns):
        poses = _facing(closing, turns + 2 * np.pi * turn / config.turns)
        for depth_m in config.depths_m:
            poses = poses.copy()
            poses[:, :3, 3] = middle_m - depth_m * poses[:, :3, 0]
            found.append(poses[_come_in(poses, points_m, fingers, config)])
    grasps = np.concatenate(found)
    return grasps[rng.permutation(len(grasps))]


def surface(
    shapes: Sequence[CollisionShape], count: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Returns points (P, 3) on shapes with outward normals (P, 3), in the body's frame."""
    triangles, normals = [], []
    for shape in shapes:
        hull = ConvexHull(_vertices_m(shape))
        corners = hull.points[hull.simplices]
        triangles.append(corners @ shape.body_from_shape[:3, :3].T + shape.body_from_shape[:3, 3])
        normals.append(hull.equations[:, :3] @ shape.body_from_shape[:3, :3].T)
    corners, normal = np.concatenate(triangles), np.concatenate(normals)
    edges = corners[:, 1:] - corners[:, :1]
    area_m2 = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    chosen = rng.choice(len(corners), count, p=area_m2 / area_m2.sum())
    u, v = rng.random((2, count, 1))
    over = u + v > 1.0
    u, v = np.where(over, 1.0 - u, u), np.where(over, 1.0 - v, v)
    points_m = corners[chosen, 0] + u * edges[chosen, 0] + v * edges[chosen, 1]
    return points_m, normal[chosen]


def _vertices_m(shape: CollisionShape) -> Array:
    if shape.kind == "convex":
        return np.asarray(shape.vertices_m, dtype=float)
    bounds = np.stack(shape_bounds_m(shape))
    return np.stack(np.meshgrid(*bounds.T), axis=-1).reshape(-1, 3)


def _opposite(
    points_m: Array, normals: Array, fingers: Fingers, config: AntipodalConfig
) -> tuple[Indices, Indices]:
    """Returns the pairs of points that two fingers can press on, as indices (K,) each."""
    gap_m = points_m[None] - points_m[:, None]
    width_m = np.linalg.norm(gap_m, axis=2)
    along = gap_m / np.maximum(width_m, 1e-9)[..., None]
    cone = np.cos(config.cone_rad)
    presses = np.einsum("ijk,ik->ij", -along, normals) > cone
    presses &= np.einsum("ijk,jk->ij", along, normals) > cone
    presses &= width_m < 2 * (fingers.open_m - config.clearance_m)
    presses &= np.arange(len(points_m))[:, None] < np.arange(len(points_m))
    first, second = np.nonzero(presses)
    return first, second


def _facing(closing: Array, turns_rad: Array) -> Array:
    """Returns poses (K, 4, 4) that close along directions (K, 3), turned about these."""
    least = np.eye(3)[np.abs(closing).argmin(axis=1)]
    u = np.cross(closing, least)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(closing, u)
    ahead = np.cos(turns_rad)[:, None] * u + np.sin(turns_rad)[:, None] * v
    poses = np.tile(np.eye(4), (len(closing), 1, 1))
    poses[:, :3, 0], poses[:, :3, 1] = ahead, closing
    poses[:, :3, 2] = np.cross(ahead, closing)
    return poses


def _come_in(poses: Array, points_m: Array, fingers: Fingers, config: AntipodalConfig) -> Bools:
    """Whether nothing of the object is in the open hand (K,)."""
    local = np.einsum("kji,kpj->kpi", poses[:, :3, :3], points_m[None] - poses[:, None, :3, 3])
    low, high = np.array(config.palm_m)
    palm = ((local > low) & (local < high)).all(axis=2).any(axis=1)
    near, far = fingers.depth_m
    beside = (local[:, :, 0] > near) & (local[:, :, 0] < far)
    beside &= np.abs(local[:, :, 2]) < config.finger_half_width_m
    aside_m = np.abs(local[:, :, 1])
    inner_m = fingers.open_m - config.clearance_m
    outer_m = fingers.open_m + config.finger_thickness_m + config.clearance_m
    finger = (beside & (aside_m > inner_m) & (aside_m < outer_m)).any(axis=1)
    return ~palm & ~finger
