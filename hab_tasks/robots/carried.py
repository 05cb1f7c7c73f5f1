"""What is in the hand when the hand is set somewhere else at once; CPU simulation."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import sapien
from numpy.typing import NDArray
from sapien.physx import PhysxArticulationLinkComponent, PhysxRigidDynamicComponent

from hab_tasks.constants import SIM_HZ
from hab_tasks.robots.handle_tie import HANDLE_SPRING

if TYPE_CHECKING:
    from hab_tasks.robots.grasp import Handle

Vector = NDArray[np.float32]


def take_along(
    body: PhysxRigidDynamicComponent, hand: PhysxArticulationLinkComponent, before: sapien.Pose
) -> None:
    """Moves a body as if it were one with the hand, and gives it the hand's velocity.

    Args:
        body: Stays where it is in the hand, even where that is not quite its place.
        hand: The hand where it is now.
        before: The pose in which it was.
    """
    moved = hand.entity_pose * before.inv()
    body.entity.set_pose(moved * body.entity_pose)
    middle = (body.entity_pose * body.cmass_local_pose).p
    reach: Any = np.subtract(middle, (hand.entity_pose * hand.cmass_local_pose).p)
    body.set_linear_velocity(hand.linear_velocity + np.cross(hand.angular_velocity, reach))
    body.set_angular_velocity(hand.angular_velocity)


def pull_along(handle: Handle, hand_m: Vector, physics_steps: int, inertia: float) -> None:
    """Gives a door or drawer the speed that brings its handle to its place in the hand.

    It is the joint's speed and not its position that is set, so that what lies in a drawer is taken
    along, and what stands in the way of a door is pushed; by no more than the spring's force.

    Args:
        handle: What is held.
        hand_m: (3,) the handle's place in the hand, in the world.
        physics_steps: After so many steps it is there, or as near as joint and force let it.
        inertia: `inertia_at` the handle.
    """
    furniture, column = handle.furniture._objs[0], handle.column
    lower, upper = handle.limits
    position = float(furniture.qpos[column])
    wanted = min(max(position + joint_way(handle, hand_m), lower), upper)
    speeds = furniture.qvel
    most = HANDLE_SPRING.force_n / inertia / SIM_HZ
    change = (wanted - position) * SIM_HZ / physics_steps - float(speeds[column])
    speeds[column] += min(max(change, -most), most)
    furniture.set_qvel(speeds)


def inertia_at(handle: Handle) -> float:
    """Returns the force at a handle that accelerates its joint by 1 m/s^2 or 1 rad/s^2 [N].

    It is the same wherever the door or drawer stands.
    """
    link: Any = handle.link._objs[0]
    if link.joint.type == "prismatic":
        return float(link.mass)
    frame = link.joint.global_pose.to_transformation_matrix()
    axis, center = frame[:3, 0], frame[:3, 3]
    middle = link.entity_pose * link.cmass_local_pose
    turned = middle.to_transformation_matrix()[:3, :3].T @ axis
    lever_m = np.linalg.norm(np.cross(axis, middle.p - center))
    point = (link.entity_pose * sapien.Pose(list(handle.offset_m))).p
    inertia_kg_m2 = float(link.inertia @ turned**2) + link.mass * lever_m**2
    return float(inertia_kg_m2 / np.linalg.norm(np.cross(axis, point - center)))


def joint_way(handle: Handle, hand_m: Vector) -> float:
    """Returns how far [m or rad] the handle's joint has to go until the handle is nearest a point.

    Args:
        handle: What is held.
        hand_m: (3,) the point in the world.
    """
    link: Any = handle.link._objs[0]
    point = (link.entity_pose * sapien.Pose(list(handle.offset_m))).p
    joint = link.joint
    # SAPIEN's joint frames have the joint's axis along x.
    frame = joint.global_pose.to_transformation_matrix()
    axis, center = frame[:3, 0], frame[:3, 3]
    if joint.type == "prismatic":
        return float(axis @ (hand_m - point))
    across, up = frame[:3, 1], frame[:3, 2]
    from_center = [(place - center) @ np.stack((across, up), axis=1) for place in (point, hand_m)]
    (x0, y0), (x1, y1) = (way.tolist() for way in from_center)
    return math.atan2(x0 * y1 - y0 * x1, x0 * x1 + y0 * y1)
