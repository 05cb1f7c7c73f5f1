"""Privileged state: ground truth for planners (S App. D, SPA-Priv).

Shapes are read back from the physics engine, so planners use exactly the simulator's collision
geometry. Geometry changes only when the scene is rebuilt (`scene_key`); poses are read for every
observation that contains the privileged group.
"""

from __future__ import annotations

from collections.abc import Mapping
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
        kind: Shape type; determines which of the fields below are used.
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
            ``<robot>/<link>``.
        group: ``stage``, ``static``, ``furniture`` (articulated), ``object`` (loose) or ``robot``.
        shapes: All its collision shapes.
    """

    name: str
    group: Literal["stage", "static", "furniture", "object", "robot"]
    shapes: tuple[CollisionShape, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class ArticulationState:
    """State of a door or drawer of the episode in one step.

    Attributes:
        kind: ``fridge`` or ``drawer``.
        body: Name of the moving body.
        handle_m: (3,) handle position in the world.
        held: Whether the robot holds the handle.
        joint: Joint position [m or rad].
        limits: Joint limits, lower and upper.
        slides: Whether the joint is prismatic; otherwise it is revolute.
        axis: (3,) direction of the joint axis in the world.
        axis_point_m: (3,) a point on the joint axis.
        frame: (3,) x, y [m] and yaw [rad] of the frame facing out of the furniture.
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
        """Returns the (4, 4) world transform of the body when its joint moves to `joint`."""
        change, motion = joint - self.joint, np.eye(4)
        if self.slides:
            motion[:3, 3] = change * self.axis
            return motion
        x, y, z = self.axis
        cross = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
        # Rodrigues' rotation formula about the axis.
        turn = np.eye(3) + np.sin(change) * cross + (1.0 - np.cos(change)) * cross @ cross
        motion[:3, :3] = turn
        motion[:3, 3] = self.axis_point_m - turn @ self.axis_point_m
        return motion


@dataclass(frozen=True, kw_only=True, eq=False)
class PrivilegedState:
    """True state of one environment row in one step.

    Attributes:
        scene_key: Changes if and only if the set of bodies or their shapes changed.
        bodies: Every body of the scene, robot links included; the same tuple until the key changes.
        world_from_body: Body name -> current (4, 4) pose. Loose objects that are not part of the
            episode are absent.
        world_from_base: (4, 4) pose of the base frame.
        arm_qpos: (J,) [rad] in the order of the robot's `arm_joints`.
        locked_qpos: All other robot joints: name -> [m or rad].
        held: Body name of the grasped object, or None.
        object_com_m: Body name -> (3,) centre of mass in the world, for loose objects present.
        targets: Body names of the objects to rearrange, in the episode's order.
        goals_m: (K, 3) goal positions of their centres of mass.
        articulations: The doors and drawers that the episode is about.
        base_goal: (3,) x, y [m] and yaw [rad] of the navigation goal; zeros without one.
    """

    scene_key: str
    bodies: tuple[CollisionBody, ...]
    world_from_body: Mapping[str, Array]
    world_from_base: Array
    arm_qpos: Array
    locked_qpos: Mapping[str, float]
    held: str | None
    object_com_m: dict[str, Array]
    targets: tuple[str, ...]
    goals_m: Array
    articulations: tuple[ArticulationState, ...] = ()
    base_goal: Array = field(default_factory=lambda: np.zeros(3))
