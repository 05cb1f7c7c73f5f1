"""Moves held objects when joint states are set directly."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import sapien
from numpy.typing import NDArray
from sapien.physx import PhysxArticulationLinkComponent, PhysxRigidDynamicComponent

from hab_tasks.constants import SIM_HZ
from hab_tasks.robots.handle import Handle
from hab_tasks.robots.handle_tie import HANDLE_SPRING
from hab_tasks.simulator import sapien_object

Vector = NDArray[np.float32]


def move_held_object(
    body: PhysxRigidDynamicComponent, hand: PhysxArticulationLinkComponent, before: sapien.Pose
) -> None:
    """Moves a body rigidly with the hand, and sets its velocity to the hand's.

    Args:
        body: The held body; it keeps its current pose in the hand, even if displaced.
        hand: The hand, at its new pose.
        before: Previous pose of the hand.
    """
    moved = hand.entity_pose * before.inv()
    body.entity.set_pose(moved * body.entity_pose)
    middle = (body.entity_pose * body.cmass_local_pose).p
    reach: Any = np.subtract(middle, (hand.entity_pose * hand.cmass_local_pose).p)
    body.set_linear_velocity(hand.linear_velocity + np.cross(hand.angular_velocity, reach))
    body.set_angular_velocity(hand.angular_velocity)


def pull_along(handle: Handle, hand_m: Vector, inertia: float) -> None:
    """Sets the velocity of a door or drawer that brings its handle to its position in the hand.

    It gets there in one physics step, as far as joint limits and force allow.

    The joint's velocity is set rather than its position, so that the content of a drawer moves with
    it and obstacles of a door are pushed, with at most the spring's force.

    Args:
        handle: The held handle.
        hand_m: (3,) target position of the handle in the world.
        inertia: `inertia_at` the handle.
    """
    furniture, column = sapien_object(handle.furniture), handle.column
    lower, upper = handle.limits
    position = float(furniture.qpos[column])
    wanted = min(max(position + joint_way(handle, hand_m), lower), upper)
    speeds = furniture.qvel
    most = HANDLE_SPRING.force_n / inertia / SIM_HZ
    change = (wanted - position) * SIM_HZ - float(speeds[column])
    speeds[column] += min(max(change, -most), most)
    furniture.set_qvel(speeds)


def inertia_at(handle: Handle) -> float:
    """Returns the force at a handle that accelerates its joint by 1 m/s^2 or 1 rad/s^2 [N].

    It does not depend on the joint position.
    """
    link: Any = sapien_object(handle.link)
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
    """Returns the joint displacement [m or rad] that moves a handle closest to a point.

    Args:
        handle: The held handle.
        hand_m: (3,) the point in the world.
    """
    link: Any = sapien_object(handle.link)
    point = (link.entity_pose * sapien.Pose(list(handle.offset_m))).p
    joint = link.joint
    # In SAPIEN, the joint axis is the x axis of the joint frame.
    frame = joint.global_pose.to_transformation_matrix()
    axis, center = frame[:3, 0], frame[:3, 3]
    if joint.type == "prismatic":
        return float(axis @ (hand_m - point))
    across, up = frame[:3, 1], frame[:3, 2]
    from_center = [(end - center) @ np.stack((across, up), axis=1) for end in (point, hand_m)]
    (x0, y0), (x1, y1) = (end.tolist() for end in from_center)
    return math.atan2(x0 * y1 - y0 * x1, x0 * x1 + y0 * y1)
