"""Shapes of the robot, the held object and the scene around the arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import coal  # pyright: ignore[reportMissingImports]  # compiled, no stubs
import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]  # compiled, no stubs
from numpy.typing import NDArray

from hab_spa.planning.batch import VOXELS, Outlines, outlines
from hab_spa.planning.coal_model import coal_shapes
from hab_spa.shapes import Array, box_distance_m, invert_pose
from hab_tasks.privileged import CollisionBody, PrivilegedState
from hab_tasks.robots.kinematics import arm_model
from hab_tasks.robots.spec import RobotSpec
from hab_tasks.world.scenes.coal_shapes import CoalShape


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
    model, _ = arm_model(robot)
    bodies = [body for body in state.bodies if body.shapes and body.name in state.world_from_body]
    roles = [_role(robot, body, held) for body in bodies]
    # Without moving shapes, every pose would be free.
    if "arm" not in roles:
        raise ValueError("collision model: the arm has no shapes; rebuild the scene.")
    placed = [
        _placed(robot, state, *entry, arm_from_world) for entry in zip(bodies, roles, strict=True)
    ]
    placed += [(0, arm_from_world)] * len(obstacles)
    known = [*map(outlines, bodies), *map(_seen, obstacles)]
    counts = [len(outline.kind) for outline in known]
    pose = np.repeat([pose for _, pose in placed], counts, axis=0)
    pose = pose @ np.concatenate([outline.body_from_shape for outline in known])
    local_m = np.concatenate([outline.local_m for outline in known])
    role = np.repeat([*roles, *["scene"] * len(obstacles)], counts)
    if not np.isfinite(pose).all():
        raise ValueError("collision model: a pose is not finite; reset the environment.")
    chosen = np.flatnonzero((role != "scene") | _near(local_m, pose, model, reach_m))
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


def _near(local_m: Array, pose: Array, model: pin.Model, reach_m: float) -> NDArray[np.bool_]:
    """Whether the bounding box of each shape (S,) is within reach of the shoulder."""
    shoulder_m = model.jointPlacements[1].translation - pose[:, :3, 3]
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
