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
        joint: (N,) joint that each moves with; 0 for the arm's root, -1 for the scene.
        pose: (N, 4, 4) poses in the joints' frames; the scene's where the root stood at first.
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

    def geometry(self, number: int) -> CoalShape:
        """Returns a shape for coal."""
        source = self.source[number]
        if isinstance(source, tuple):
            return coal_shapes(source[0])[source[1]]
        return coal.makeOctree(source.centres_m, source.size_m), np.eye(4)


class CoalModel:
    """Coal's answers for pairs of shapes, with their current poses in their joints' frames.

    Attributes:
        root: Pose of the arm's root in the frame of the scene's shapes.
    """

    def __init__(self, model: pin.Model, items: Items) -> None:
        """Takes the model of the arm, and the shapes; their poses are not copied."""
        self._model, self._data = model, model.createData()
        self._items, self._joints, self.root = items, items.joint.tolist(), pin.SE3.Identity()
        self._shapes: dict[int, CoalShape] = {}
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
        # Coal is asked about few of the shapes, and an octree takes longer to make than a plan.
        if number not in self._shapes:
            self._shapes[number] = self._items.geometry(number)
        geometry, offset = self._shapes[number]
        pose = pin.SE3(self._items.pose[number] @ offset)
        if (joint := self._joints[number]) >= 0:
            pose = self.root * self._data.oMi[joint] * pose
        return geometry, coal.Transform3s(pose.rotation, pose.translation)


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
    joints, poses = _placed(robot, state, bodies, roles, arm_from_world, len(obstacles))
    known = [*map(outlines, bodies), *map(_seen, obstacles)]
    counts = [len(outline.kind) for outline in known]
    pose = np.repeat(poses, counts, axis=0)
    pose = pose @ np.concatenate([outline.body_from_shape for outline in known])
    local_m = np.concatenate([outline.local_m for outline in known])
    role = np.repeat([*roles, *["scene"] * len(obstacles)], counts)
    if not np.isfinite(pose).all():
        raise ValueError("collision model: a pose is not finite; reset the environment.")
    chosen = np.flatnonzero((role != "scene") | _near(robot, local_m, pose, reach_m))
    sources = [(body, i) for body in bodies for i in range(len(body.shapes))] + list(obstacles)
    vertices_m = [own for outline in known for own in outline.vertices_m]
    names = np.repeat([*(b.name for b in bodies), *(o.name for o in obstacles)], counts)
    names = names[chosen]
    return Items(
        source=[sources[number] for number in chosen],
        body=names,
        link=np.array([_link(name) for name in names]),
        role=role[chosen],
        joint=np.repeat(joints, counts)[chosen],
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
    robot: RobotSpec,
    state: PrivilegedState,
    bodies: Sequence[CollisionBody],
    roles: Sequence[str],
    arm_from_world: Array,
    obstacles: int,
) -> tuple[list[int], Array]:
    """Returns joints (see `Items`) and poses (B, 4, 4) of bodies and obstacles."""
    (model, _), world_from_body = arm_model(robot), state.world_from_body
    # Obstacles are stated in the world.
    poses = np.stack([*(world_from_body[b.name] for b in bodies), *[np.eye(4)] * obstacles])
    joints = [0 if role == "robot" else -1 for role in roles] + [-1] * obstacles
    gripper = model.frames[model.getFrameId(robot.ee_link)]
    world_from_gripper = next(
        pose for name, pose in world_from_body.items() if _link(name) == robot.ee_link
    )
    wrist_from_gripper, gripper_from_world = (
        gripper.placement.homogeneous,
        invert_pose(world_from_gripper),
    )
    placed = arm_from_world @ poses
    for i, (body, role) in enumerate(zip(bodies, roles, strict=True)):
        link = _link(body.name)
        # Fingers are placed as they are, like a held object: the model has the arm's joints only.
        if role == "held" or link in robot.finger_links:
            joints[i] = gripper.parentJoint
            placed[i] = wrist_from_gripper @ (gripper_from_world @ poses[i])
        elif role == "arm":
            frame = model.frames[model.getFrameId(link)]
            joints[i], placed[i] = frame.parentJoint, frame.placement.homogeneous
    return joints, placed


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
