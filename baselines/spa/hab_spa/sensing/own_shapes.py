"""The robot's collision shapes from its URDF, for filtering point clouds (S App. D)."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]  # compiled, no stubs
import trimesh
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from hab_spa.planning.collision import shared_arm_model
from hab_spa.shapes import Array
from hab_tasks.privileged import CollisionBody, CollisionShape
from hab_tasks.robots.fetch import FETCH

PREFIX = f"{FETCH.uid}/"
"""Prefix of body names, as in the simulator."""


@lru_cache(maxsize=1)
def own_bodies() -> tuple[CollisionBody, ...]:
    """Returns one body per link with collision meshes, of their convex hulls."""
    bodies = []
    for link in ElementTree.parse(FETCH.urdf_path()).getroot().iter("link"):
        shapes = [_hull(collision) for collision in link.findall("collision")]
        if shapes:
            name = PREFIX + link.get("name", "")
            bodies.append(CollisionBody(name=name, group="robot", shapes=tuple(shapes)))
    return tuple(bodies)


def own_poses(world_from_base: Array, arm_rad: Array) -> dict[str, Array]:
    """Returns the pose (4, 4) of each body; torso, head and fingers are locked.

    Args:
        world_from_base: (4, 4) pose of base_link.
        arm_rad: (7,) joint positions of the arm.
    """
    model, _ = shared_arm_model()
    data = model.createData()
    pin.forwardKinematics(model, data, arm_rad)
    pin.updateFramePlacements(model, data)
    names = [body.name for body in own_bodies()]
    return {
        name: world_from_base @ data.oMf[model.getFrameId(name[len(PREFIX) :])].homogeneous
        for name in names
    }


def inside_robot(points_m: Array, poses: Mapping[str, Array], margin_m: float) -> NDArray[np.bool_]:
    """Whether world points (K, 3) are inside the robot or within about `margin_m` of it.

    Args:
        points_m: The points.
        poses: Poses of the bodies, from `own_poses`.
        margin_m: Enlargement of the hulls; larger at corners.
    """
    directions = _directions()
    inside = np.zeros(len(points_m), dtype=bool)
    outlines = _outlines()
    frames = [poses[name] for name, *_ in outlines]
    centres_m = np.array(
        [
            pose[:3, :3] @ centre_m + pose[:3, 3]
            for pose, (_, _, centre_m, _) in zip(frames, outlines, strict=True)
        ]
    )
    gaps_m2 = cdist(centres_m, points_m, "sqeuclidean")
    for pose, at_m, gap_m2, outline in zip(frames, centres_m, gaps_m2, outlines, strict=True):
        _, heights_m, _, radius_m = outline
        near = np.flatnonzero(gap_m2 <= (radius_m + margin_m) ** 2)
        along_m = (points_m[near] - at_m) @ (pose[:3, :3] @ directions.T)
        inside[near[(along_m <= heights_m + margin_m).all(axis=1)]] = True
    return inside


@lru_cache(maxsize=1)
def _directions() -> Array:
    """Returns directions (D, 3) of the hulls' outlines; more are not worth it given the margin."""
    return np.asarray(trimesh.creation.icosphere(subdivisions=1).vertices, dtype=float)


@lru_cache(maxsize=1)
def _outlines() -> tuple[tuple[str, Array, Array, float], ...]:
    """Returns (body, extents (D,), centre (3,) in the body's frame, radius) of each hull."""
    found = []
    for body in own_bodies():
        for shape in body.shapes:
            pose = shape.body_from_shape
            vertices_m = shape.vertices_m @ pose[:3, :3].T + pose[:3, 3]
            centre_m = (vertices_m.min(axis=0) + vertices_m.max(axis=0)) / 2
            reach_m = vertices_m - centre_m
            heights_m = (reach_m @ _directions().T).max(axis=0)
            radius_m = float(np.linalg.norm(reach_m, axis=1).max())
            found.append((body.name, heights_m, centre_m, radius_m))
    return tuple(found)


def _hull(collision: ElementTree.Element) -> CollisionShape:
    """Returns the convex hull of a collision mesh, the only supported kind of shape."""
    mesh = collision.find("geometry/mesh")
    if mesh is None:
        raise ValueError(
            f"{FETCH.urdf_path()}: own_shapes.py supports only meshes as collision shapes."
        )
    loaded = trimesh.load_mesh(FETCH.urdf_path().parent / mesh.get("filename", ""))
    hull = loaded.convex_hull
    return CollisionShape(
        kind="convex",
        body_from_shape=_origin(collision.find("origin")),
        half_size_m=np.zeros(3),
        vertices_m=np.asarray(hull.vertices, dtype=float),
        faces=np.asarray(hull.faces, dtype=np.int64),
    )


def _origin(element: ElementTree.Element | None) -> Array:
    if element is None:
        return np.eye(4)
    xyz, rpy = (np.array(element.get(key, "0 0 0").split(), dtype=float) for key in ("xyz", "rpy"))
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz).homogeneous
