"""Shapes of the robot, the held object and the scene around the arm; coal's answers for pairs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import coal  # pyright: ignore[reportMissingImports]  # compiled, no stubs
import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]  # compiled, no stubs
from numpy.typing import NDArray

from hab_spa.planning.batch import VOXELS, Outlines, outlines
from hab_spa.shapes import Array, box_distance_m, invert_pose
from hab_tasks.privileged import CollisionBody, PrivilegedState
from hab_tasks.robots.kinematics import arm_model
from hab_tasks.robots.spec import RobotSpec
from hab_tasks.world.scenes.coal_shapes import CoalShape, coal_shape

_shapes: WeakKeyDictionary[CollisionBody, list[CoalShape]] = WeakKeyDictionary()


def coal_shapes(body: CollisionBody) -> list[CoalShape]:
    """Returns the coal shapes of a body, in order; made once, shared by all scenes with it."""
    if body not in _shapes:
        _shapes[body] = [coal_shape(shape) for shape in body.shapes]
    return _shapes[body]


@dataclass(frozen=True, kw_only=True)
class Contact:
    """Two shapes closer than their margin; `distance_m` is negative when they penetrate."""

    pair: int
    first: str
    second: str
    distance_m: float


class CoalModel:
    """The shapes of a collision model, with their current poses in their joints' frames."""

    def __init__(
        self, model: pin.Model, shapes: Sequence[CoalShape], joints: NDArray[np.int64], poses: Array
    ) -> None:
        """Takes the shapes of an arm.

        Args:
            model: The arm.
            shapes: N shapes.
            joints: (N,) the joint that each moves with; 0 for the root.
            poses: (N, 4, 4) their poses in the joints' frames; not copied.
        """
        self._model, self._data = model, model.createData()
        self._shapes, self._joints, self._poses = shapes, joints.tolist(), poses
        self._request = coal.CollisionRequest(coal.CollisionRequestFlag.NO_REQUEST, 1)

    def collides(self, qpos: Array, first: int, second: int, margin_m: float) -> bool:
        """Whether two shapes are closer than a margin at an arm pose (J,) [rad]."""
        pin.forwardKinematics(self._model, self._data, qpos)
        self._request.security_margin = margin_m
        self._request.distance_upper_bound = margin_m + 1e-6  # as Pinocchio does
        placed = (*self._placed(first), *self._placed(second))
        return coal.collide(*placed, self._request, coal.CollisionResult()) > 0

    def distance_m(self, qpos: Array, first: int, second: int) -> float:
        """Returns the distance of two shapes; negative when they penetrate."""
        pin.forwardKinematics(self._model, self._data, qpos)
        placed = (*self._placed(first), *self._placed(second))
        return coal.distance(*placed, coal.DistanceRequest(), coal.DistanceResult())

    def _placed(self, number: int) -> tuple[coal.CollisionGeometry, coal.Transform3s]:
        geometry, offset = self._shapes[number]
        pose = self._data.oMi[self._joints[number]] * pin.SE3(self._poses[number] @ offset)
        return geometry, coal.Transform3s(pose.rotation, pose.translation)


@dataclass(frozen=True, kw_only=True, eq=False)
class Obstacle:
    """An obstacle seen by a camera: voxels.

    Attributes:
        name: Name in reports of contacts.
        centres_m: (V, 3) their centres in the world; near ones follow each other.
        size_m: Their edge.
    """

    name: str
    centres_m: Array
    size_m: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Items:
    """Shapes of a collision model, in the order of their bodies.

    Attributes:
        source: Body of each and its number in it, or the obstacle.
        body, link: (N,) names of body and link.
        role: (N,) ``arm``, ``held``, ``robot`` or ``scene``; the first two move.
        joint: (N,) joint that each moves with; 0 for the arm's root.
        pose: (N, 4, 4) poses in the joints' frames.
        local_m, kind, vertices_m: See `Outlines`.
    """

    source: list[tuple[CollisionBody, int] | Obstacle]
    body: NDArray[np.str_]
    link: NDArray[np.str_]
    role: NDArray[np.str_]
    joint: NDArray[np.int64]
    pose: Array
    local_m: Array
    kind: NDArray[np.int64]
    vertices_m: list[Array]

    def name(self, number: int) -> str:
        """Returns the name of a shape in reports of contacts."""
        source = self.source[number]
        return f"{self.body[number]}#{source[1]}" if isinstance(source, tuple) else source.name

    def geometries(self) -> list[CoalShape]:
        """Returns the shapes for coal."""
        return [
            coal_shapes(source[0])[source[1]]
            if isinstance(source, tuple)
            else (coal.makeOctree(source.centres_m, source.size_m), np.eye(4))
            for source in self.source
        ]


def moving_links(robot: RobotSpec) -> tuple[str, ...]:
    """Returns the links that move with the arm."""
    return (*robot.arm_links, robot.ee_link, *robot.finger_links)


def collect(
    robot: RobotSpec,
    state: PrivilegedState,
    held: str | None,
    obstacles: Sequence[Obstacle],
    arm_from_world: Array,
    reach_m: float,
) -> Items:
    """Returns the shapes of the robot and the held object, and those within reach of the shoulder.

    Args:
        robot: The robot.
        state: Its state, and the bodies around it.
        held: Name of the body that moves with the gripper.
        obstacles: Additional obstacles.
        arm_from_world: (4, 4) pose of the world in the frame of the arm's root.
        reach_m: Maximum distance of the scene's shapes.

    Raises:
        ValueError: A shape or pose is not finite, or the arm has no shapes.
    """
    # Objects that are not part of the episode are bodies without a pose.
    bodies = [body for body in state.bodies if body.shapes and body.name in state.world_from_body]
    roles = [_role(robot, body, held) for body in bodies]
    # Without moving shapes, every pose would be free.
    if "arm" not in roles:
        raise ValueError("collision model: the arm has no shapes; rebuild the scene.")
    placed = [_placed(robot, state, *of, arm_from_world) for of in zip(bodies, roles, strict=True)]
    placed += [(0, arm_from_world)] * len(obstacles)
    known = [*map(outlines, bodies), *map(_seen, obstacles)]
    counts = [len(outline.kind) for outline in known]
    pose = np.repeat([pose for _, pose in placed], counts, axis=0)
    pose = pose @ np.concatenate([outline.body_from_shape for outline in known])
    local_m = np.concatenate([outline.local_m for outline in known])
    role = np.repeat([*roles, *["scene"] * len(obstacles)], counts)
    if not np.isfinite(pose).all():
        raise ValueError("collision model: a pose is not finite; reset the environment.")
    chosen = np.flatnonzero((role != "scene") | _near(robot, local_m, pose, reach_m))
    sources = [(body, i) for body in bodies for i in range(len(body.shapes))] + list(obstacles)
    vertices_m = [own for outline in known for own in outline.vertices_m]
    names = np.repeat([*(b.name for b in bodies), *(o.name for o in obstacles)], counts)
    joints, names = np.repeat([joint for joint, _ in placed], counts), names[chosen]
    return Items(
        source=[sources[number] for number in chosen],
        body=names,
        link=np.array([_link(name) for name in names]),
        role=role[chosen],
        joint=joints[chosen],
        pose=pose[chosen],
        local_m=local_m[chosen],
        kind=np.concatenate([outline.kind for outline in known])[chosen],
        vertices_m=[vertices_m[number] for number in chosen],
    )


def _near(robot: RobotSpec, local_m: Array, pose: Array, reach_m: float) -> NDArray[np.bool_]:
    """Whether the bounding box of each shape (S,) is within reach of the shoulder."""
    shoulder_m = arm_model(robot)[0].jointPlacements[1].translation - pose[:, :3, 3]
    # In the frame of each shape, whose bounding box has the axes of that frame.
    shoulder_m = (pose[:, :3, :3].transpose(0, 2, 1) @ shoulder_m[:, :, None])[:, :, 0]
    radius_m = local_m[:, 6:7]
    lower_m, upper_m = local_m[:, :3] - radius_m, local_m[:, 3:6] + radius_m
    return box_distance_m(shoulder_m, lower_m, upper_m) < reach_m


def _link(name: str) -> str:
    return name.rsplit("/", 1)[-1]


def _role(robot: RobotSpec, body: CollisionBody, held: str | None) -> str:
    if body.name == held:
        return "held"
    if body.group != "robot":
        return "scene"
    return "arm" if _link(body.name) in moving_links(robot) else "robot"


def _placed(
    robot: RobotSpec, state: PrivilegedState, body: CollisionBody, role: str, arm_from_world: Array
) -> tuple[int, Array]:
    """Returns a body's joint and pose (4, 4) in it: of the arm, the wrist if held, or the root."""
    link, poses, (model, _) = _link(body.name), state.world_from_body, arm_model(robot)
    # Fingers are placed as they are, like a held object: the model has the arm's joints only.
    if role == "held" or link in robot.finger_links:
        gripper = model.frames[model.getFrameId(robot.ee_link)]
        world_from_gripper = next(poses[key] for key in poses if _link(key) == robot.ee_link)
        own = invert_pose(world_from_gripper) @ poses[body.name]
        return gripper.parentJoint, gripper.placement.homogeneous @ own
    if role == "arm":
        frame = model.frames[model.getFrameId(link)]
        return frame.parentJoint, frame.placement.homogeneous
    return 0, arm_from_world @ poses[body.name]


def _seen(obstacle: Obstacle) -> Outlines:
    """Returns the shape of an obstacle in the world."""
    half_m = obstacle.size_m / 2
    lower_m = obstacle.centres_m.min(axis=0) - half_m
    upper_m = obstacle.centres_m.max(axis=0) + half_m
    diagonal_m = np.linalg.norm(upper_m - lower_m)
    return Outlines(
        body_from_shape=np.eye(4)[None],
        local_m=np.array([(*lower_m, *upper_m, 0.0, diagonal_m / 2, half_m)]),
        kind=np.array([VOXELS]),
        vertices_m=[obstacle.centres_m],
    )
