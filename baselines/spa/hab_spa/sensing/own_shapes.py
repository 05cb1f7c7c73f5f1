"""The robot's own shapes, from its description: what SPA knows without being told (S App. D)."""

from __future__ import annotations

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
from hab_tasks.robots.fetch_spec import urdf_path

PREFIX = "hab_fetch/"
"""Bodies are named as the simulator names them."""


@lru_cache(maxsize=1)
def own_bodies() -> tuple[CollisionBody, ...]:
    """Returns one body for each link that has collision meshes: their convex hulls."""
    bodies = []
    for link in ElementTree.parse(urdf_path()).getroot().iter("link"):
        shapes = [_hull(collision) for collision in link.findall("collision")]
        if shapes:
            name = PREFIX + link.get("name", "")
            bodies.append(CollisionBody(name=name, group="robot", shapes=tuple(shapes)))
    return tuple(bodies)


def own_poses(world_from_base: Array, arm_rad: Array) -> dict[str, Array]:
    """Returns the pose (4, 4) of each of the bodies, torso, head and fingers being locked.

    Args:
        world_from_base: (4, 4) pose of base_link.
        arm_rad: (7,) the arm.
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


def inside_robot(points_m: Array, poses: dict[str, Array], margin_m: float) -> NDArray[np.bool_]:
    """Whether points (K, 3) of the world are in the robot or nearer than about `margin_m` to it.

    Args:
        points_m: The points.
        poses: As `own_poses` returns them.
        margin_m: Hulls are this much wider; what has corners grows more there.
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
    """Directions (D, 3) in which a hull's extent is known; more gain nothing beside the margin."""
    return np.asarray(trimesh.creation.icosphere(subdivisions=1).vertices, dtype=float)


@lru_cache(maxsize=1)
def _outlines() -> tuple[tuple[str, Array, Array, float], ...]:
    """Body, extent (D,) of the hull from its centre (3,) in the body's frame, and its radius."""
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
    """The convex hull of a collision mesh; Fetch has no other collision shapes."""
    mesh = collision.find("geometry/mesh")
    if mesh is None:
        raise ValueError(f"A collision shape of {urdf_path()} is no mesh; own_shapes.py needs one.")
    loaded = trimesh.load_mesh(urdf_path().parent / mesh.get("filename", ""))
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
