"""Ground truth for planners that are allowed to see it (S App. D, SPA-Priv).

The shapes are read back from the physics engine, so a planner's geometry is the simulator's
geometry, hull for hull. Geometry changes only when the scene is rebuilt (`scene_key`); poses
are read at every observation that holds the privileged group.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ShapeKind = Literal["box", "convex", "sphere", "capsule", "cylinder", "plane"]


@dataclass(frozen=True, kw_only=True, eq=False)
class CollisionShape:
    """One collision shape in its body's frame.

    Attributes:
        kind: Which of the fields below describe it.
        body_from_shape: (4, 4) pose of the shape in the body frame.
        half_size_m: (3,) half extents of a box; (radius, half length, 0) of a capsule or cylinder
            (axis x, as in PhysX); (radius, 0, 0) of a sphere; zeros for a plane (normal +x).
        vertices_m: (V, 3) hull vertices of a convex shape, scale applied; (0, 3) otherwise.
        faces: (F, 3) int triangles of a convex shape; (0, 3) otherwise.
    """

    kind: ShapeKind
    body_from_shape: Array
    half_size_m: Array
    vertices_m: Array
    faces: NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, eq=False)
class CollisionBody:
    """A rigid body: a static object, a link of furniture, a loose object or a robot link.

    Attributes:
        name: Unique in the scene, e.g. ``kitchen_counter_0/drawer3``, ``024_bowl``,
            ``hab_fetch/gripper_link``.
        group: ``stage``, ``static``, ``furniture`` (articulated), ``object`` (loose) or ``robot``.
        shapes: All its collision shapes.
    """

    name: str
    group: Literal["stage", "static", "furniture", "object", "robot"]
    shapes: tuple[CollisionShape, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class FrontState:
    """A door or drawer that the episode is about, at one moment.

    Attributes:
        kind: ``fridge`` or ``drawer``.
        body: Name of the body that moves.
        handle_m: (3,) its handle in the world.
        held: Whether the hand holds the handle.
        joint: Its position [m or rad].
        limits: Lowest and highest position.
        slides: Whether it slides along its axis; else it turns about it.
        axis: (3,) direction of its axis in the world.
        axis_point_m: (3,) a point of its axis.
        frame: (3,) x, y [m] and yaw [rad] of the frame that looks out of the furniture.
    """

    kind: str
    body: str
    handle_m: Array
    held: bool
    joint: float
    limits: tuple[float, float]
    slides: bool
    axis: Array
    axis_point_m: Array
    frame: Array

    def moved(self, joint: float) -> Array:
        """Returns (4, 4) how a point of it moves in the world until its joint is at `joint`."""
        way, motion = joint - self.joint, np.eye(4)
        if self.slides:
            motion[:3, 3] = way * self.axis
            return motion
        x, y, z = self.axis
        cross = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
        # Rodrigues' formula of a turn about the axis.
        turn = np.eye(3) + np.sin(way) * cross + (1.0 - np.cos(way)) * cross @ cross
        motion[:3, :3] = turn
        motion[:3, 3] = self.axis_point_m - turn @ self.axis_point_m
        return motion


@dataclass(frozen=True, kw_only=True, eq=False)
class PrivilegedState:
    """The true state of one environment row at one moment.

    Attributes:
        scene_key: Changes if and only if the set of bodies or their shapes changed.
        bodies: Every body of the scene, robot links included; the same tuple until the key changes.
        world_from_body: Body name -> (4, 4) pose now. Loose objects that take no part in the
            episode are absent.
        world_from_base: (4, 4) pose of Fetch's base_link.
        arm_qpos: (7,) [rad] in `hab_tasks.robots.fetch_spec.ARM_JOINTS` order.
        locked_qpos: Every other joint of the robot: name -> [m or rad].
        held: Body name of the object in the grasp, None if none.
        object_com_m: Body name -> (3,) centre of mass in the world, of the loose objects present.
        targets: Body names of the objects to rearrange, in the episode's order.
        goals_m: (K, 3) where the centres of mass of these are to be.
        fronts: The doors and drawers that the episode is about.
        base_goal: (3,) x, y [m] and yaw [rad] that Navigate leads to; zeros elsewhere.
    """

    scene_key: str
    bodies: tuple[CollisionBody, ...]
    world_from_body: dict[str, Array]
    world_from_base: Array
    arm_qpos: Array
    locked_qpos: dict[str, float]
    held: str | None
    object_com_m: dict[str, Array]
    targets: tuple[str, ...]
    goals_m: Array
    fronts: tuple[FrontState, ...] = ()
    base_goal: Array = field(default_factory=lambda: np.zeros(3))
