"""Constraint between the gripper and what it holds, which may be moved directly."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import sapien
from numpy.typing import NDArray
from sapien.physx import PhysxArticulationLinkComponent, PhysxRigidDynamicComponent

from hab_tasks.arrays import Floats
from hab_tasks.constants import SIM_HZ
from hab_tasks.robots.handle import HANDLE_SPRING, Handle
from hab_tasks.robots.mobile_manipulator import MobileManipulator
from hab_tasks.simulator import sapien_object

Vector = NDArray[np.float32]


def move_held_object(
    body: PhysxRigidDynamicComponent, hand: PhysxArticulationLinkComponent, before: sapien.Pose
) -> None:
    """Moves a body rigidly with the hand, and sets its velocity to the hand's.

    It keeps its current pose in the hand, even if displaced; `before` is the hand's previous pose.
    """
    moved = hand.entity_pose * before.inv()
    body.entity.set_pose(moved * body.entity_pose)
    middle = (body.entity_pose * body.cmass_local_pose).p
    reach: Any = np.subtract(middle, (hand.entity_pose * hand.cmass_local_pose).p)
    body.set_linear_velocity(hand.linear_velocity + np.cross(hand.angular_velocity, reach))
    body.set_angular_velocity(hand.angular_velocity)


def pull_along(handle: Handle, hand_m: Vector, inertia: float) -> None:
    """Sets the velocity of a door or drawer that brings its handle to `hand_m` (3,) in the world.

    It gets there in one physics step, as far as joint limits and force allow. The joint's velocity
    is set rather than its position, so that the content of a drawer moves with it and obstacles of
    a door are pushed, with at most the spring's force; `inertia` is `inertia_at` the handle.
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
    link = handle.body
    if link.joint.type == "prismatic":
        return float(link.mass)
    frame = link.joint.global_pose.to_transformation_matrix()
    axis, center = frame[:3, 0], frame[:3, 3]
    middle = link.entity_pose * link.cmass_local_pose
    turned = middle.to_transformation_matrix()[:3, :3].T @ axis
    lever_m = np.linalg.norm(np.cross(axis, middle.p - center))
    point = handle.pose().p
    inertia_kg_m2 = float(link.inertia @ turned**2) + link.mass * lever_m**2
    return float(inertia_kg_m2 / np.linalg.norm(np.cross(axis, point - center)))


def joint_way(handle: Handle, hand_m: Vector) -> float:
    """Returns the joint's way [m or rad] that moves a handle closest to a world point (3,)."""
    link = handle.body
    point = handle.pose().p
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


HOLD_STIFFNESS_NM_RAD = 1e5
HOLD_DAMPING_NM_S_RAD = 1e3


class Tie:
    """Holds one body: an object by a rigid joint, a handle by a force-limited spring.

    Attributes:
        pulls_along: Whether a held handle follows the hand kinematically instead of by a spring,
            as the furniture's inertia would throw back an arm whose state is set directly.
    """

    def __init__(self, agent: MobileManipulator, *, pulls_along: bool) -> None:
        """Ties nothing to the robot's hand yet."""
        self.pulls_along = pulls_along
        self._scene, self._hand = agent.scene.sub_scenes[0], sapien_object(agent.ee_link)
        self._link_from_ee = agent.link_from_ee
        self._drive: Any = None
        self._body: PhysxRigidDynamicComponent | None = None
        self._handle: Handle | None = None
        self._hand_before = sapien.Pose()
        self._pulls_now, self._inertia = False, 0.0

    def hold_object(self, body: PhysxRigidDynamicComponent, hand_from_object: sapien.Pose) -> None:
        """Holds a body at its pose in the hand."""
        self._body, self._hand_before = body, self._hand.entity_pose
        drive = self._connect(hand_from_object, body.entity, sapien.Pose())
        for lock in (drive.set_limit_x, drive.set_limit_y, drive.set_limit_z):
            lock(0.0, 0.0)
        # Zero angular limits do not hold against an articulation link (measured: 50 degrees).
        drive.set_drive_property_slerp(HOLD_STIFFNESS_NM_RAD, HOLD_DAMPING_NM_S_RAD)
        body.wake_up()

    def hold_handle(self, handle: Handle, in_ee_m: Floats) -> None:
        """Holds a handle at a position (3,) in the end-effector's frame."""
        self._handle = handle
        drive = self._connect(self._link_from_ee, handle.body.entity, handle.body_from_handle)
        if self.pulls_along:  # `pull_along` moves the furniture; the constraint has no spring
            self._inertia = inertia_at(handle)
            return
        spring = HANDLE_SPRING
        # SAPIEN's force limit is an impulse per physics step (measured).
        most_n_s = spring.force_n / SIM_HZ
        for axis in "xyz":
            pull = getattr(drive, f"set_drive_property_{axis}")
            pull(spring.stiffness_n_m, spring.damping_n_s_m, most_n_s)
        self.draw_in(in_ee_m)

    def draw_in(self, in_ee_m: Floats) -> None:
        """Sets the position (3,) of the held handle in the end-effector's frame."""
        self._drive.set_drive_target(sapien.Pose(in_ee_m))

    def release(self) -> None:
        """Unties what is held."""
        self._drive.entity.remove_component(self._drive)
        self._drive = self._body = self._handle = None

    def carry(self) -> None:
        """Moves a held object with a hand whose state was set."""
        if self._body is not None:
            move_held_object(self._body, self._hand, self._hand_before)
            self._hand_before = self._hand.entity_pose
        self._pulls_now = self.pulls_along

    def before_physics_step(self, in_ee_m: Floats) -> None:
        """Moves the furniture of a handle, held at (3,), to a hand whose state was set."""
        if self._pulls_now and self._handle is not None:
            world_from_ee = self._hand.entity_pose * self._link_from_ee
            place_m = np.asarray((world_from_ee * sapien.Pose(in_ee_m)).p)
            pull_along(self._handle, place_m, self._inertia)
            self._pulls_now = False

    def after_control_step(self) -> None:
        """Stores the hand's pose."""
        if self._drive is not None:
            self._hand_before = self._hand.entity_pose

    def _connect(self, pose0: sapien.Pose, entity: sapien.Entity, pose1: sapien.Pose) -> Any:
        self._drive = self._scene.create_drive(self._hand.entity, pose0, entity, pose1)
        return self._drive
