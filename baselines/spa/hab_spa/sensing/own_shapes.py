"""The robot's collision shapes from its URDF, for filtering point clouds (S App. D)."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]  # compiled, no stubs
import trimesh
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from hab_spa.shapes import Array
from hab_tasks.privileged import CollisionBody, CollisionShape
from hab_tasks.robots.kinematics import arm_model
from hab_tasks.robots.spec import RobotSpec


class OwnShapes:
    """Collision shapes of a robot.

    Attributes:
        bodies: One body per link with collision shapes, of their convex hulls.
    """

    def __init__(self, robot: RobotSpec) -> None:
        """Loads the shapes."""
        self._robot, self._model = robot, arm_model(robot)[0]
        links = robot.urdf_tree().iter("link")
        hulls = {
            # As in the simulator, the robot is the prefix of its bodies' names.
            f"{robot.uid}/{link.get('name')}": [_hull(c) for c in link.findall("collision")]
            for link in links
        }
        self.bodies = tuple(
            CollisionBody(name=name, group="robot", shapes=tuple(shapes))
            for name, shapes in hulls.items()
            if shapes
        )
        # More directions of the outlines are not worth it, given the margin.
        icosphere = trimesh.creation.icosphere(subdivisions=1)
        self._directions = np.asarray(icosphere.vertices, dtype=float)  # (D, 3)
        self._outlines = [
            (body.name, *self._outline(shape)) for body in self.bodies for shape in body.shapes
        ]

    def poses(self, world_from_base: Array, arm_rad: Array) -> dict[str, Array]:
        """Returns the pose (4, 4) of each body; torso, head and fingers are locked.

        Args:
            world_from_base: (4, 4) pose of base_link.
            arm_rad: (J,) joint positions of the arm.
        """
        model, data = self._model, self._model.createData()
        pin.forwardKinematics(model, data, arm_rad)
        pin.updateFramePlacements(model, data)
        frames = {body.name: model.getFrameId(body.name.split("/")[1]) for body in self.bodies}
        return {n: world_from_base @ data.oMf[k].homogeneous for n, k in frames.items()}

    def contain(
        self, points_m: Array, poses: Mapping[str, Array], margin_m: float
    ) -> NDArray[np.bool_]:
        """Whether world points (K, 3) are inside the robot or within about `margin_m` of it.

        Args:
            points_m: The points.
            poses: Poses of the bodies, from `poses`.
            margin_m: Enlargement of the hulls; larger at corners.
        """
        inside = np.zeros(len(points_m), dtype=bool)
        frames = [poses[name] for name, *_ in self._outlines]
        centres_m = np.array(
            [
                pose[:3, :3] @ centre_m + pose[:3, 3]
                for pose, (_, _, centre_m, _) in zip(frames, self._outlines, strict=True)
            ]
        )
        gaps_m2 = cdist(centres_m, points_m, "sqeuclidean")
        entries = zip(frames, centres_m, gaps_m2, self._outlines, strict=True)
        for pose, at_m, gap_m2, (_, heights_m, _, radius_m) in entries:
            near = np.flatnonzero(gap_m2 <= (radius_m + margin_m) ** 2)
            along_m = (points_m[near] - at_m) @ (pose[:3, :3] @ self._directions.T)
            inside[near[(along_m <= heights_m + margin_m).all(axis=1)]] = True
        return inside

    def _outline(self, shape: CollisionShape) -> tuple[Array, Array, float]:
        """Returns a hull's extents (D,), centre (3,) in the body's frame, and radius."""
        pose = shape.body_from_shape
        vertices_m = shape.vertices_m @ pose[:3, :3].T + pose[:3, 3]
        centre_m = (vertices_m.min(axis=0) + vertices_m.max(axis=0)) / 2
        reach_m = vertices_m - centre_m
        heights_m = (reach_m @ self._directions.T).max(axis=0)
        return heights_m, centre_m, float(np.linalg.norm(reach_m, axis=1).max())


@cache
def own_shapes(robot: RobotSpec) -> OwnShapes:
    """Returns a robot's shapes; loaded once a process."""
    return OwnShapes(robot)


def _hull(collision: ElementTree.Element) -> CollisionShape:
    """Returns the convex hull of a collision shape.

    Raises:
        ValueError: The shape is neither a mesh nor a box.
    """
    hull = _solid(collision).convex_hull
    return CollisionShape(
        kind="convex",
        body_from_shape=_origin(collision.find("origin")),
        half_size_m=np.zeros(3),
        vertices_m=np.asarray(hull.vertices, dtype=float),
        faces=np.asarray(hull.faces, dtype=np.int64),
    )


def _solid(collision: ElementTree.Element) -> trimesh.Trimesh:
    if (mesh := collision.find("geometry/mesh")) is not None:
        return trimesh.load_mesh(mesh.get("filename", ""))
    if (box := collision.find("geometry/box")) is not None:
        return trimesh.creation.box([float(side) for side in box.get("size", "").split()])
    raise ValueError("Collision shapes of robots are meshes or boxes.")


def _origin(element: ElementTree.Element | None) -> Array:
    if element is None:
        return np.eye(4)
    xyz, rpy = (np.array(element.get(key, "0 0 0").split(), dtype=float) for key in ("xyz", "rpy"))
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz).homogeneous
