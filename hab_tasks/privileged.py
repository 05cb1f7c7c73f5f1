"""Ground truth for planners that are allowed to see it (S App. D, SPA-Priv).

The shapes are read back from the physics engine, so a planner's geometry is the simulator's
geometry, hull for hull. Geometry changes only when the scene is rebuilt (`scene_key`); poses
are read at every observation that holds the privileged group.
"""

from __future__ import annotations

from dataclasses import dataclass
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
        target: Body name of the object (or handle's link) the skill is about.
        held: Body name of what is in the grasp, None if nothing.
        object_com_m: Body name -> (3,) centre of mass in the world, of the loose objects present.
    """

    scene_key: str
    bodies: tuple[CollisionBody, ...]
    world_from_body: dict[str, Array]
    world_from_base: Array
    arm_qpos: Array
    locked_qpos: dict[str, float]
    target: str
    held: str | None
    object_com_m: dict[str, Array]
