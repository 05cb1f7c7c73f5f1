"""Snapshot of the simulator, read once per control step, and contact force on the robot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from sapien.physx import PhysxRigidStaticComponent

from hab_tasks.arrays import Batch, Bools, Floats, Ints
from hab_tasks.constants import CONTROL_HZ
from hab_tasks.robots.grasp import Grasp
from hab_tasks.robots.mobile_manipulator import MobileManipulator
from hab_tasks.simulator import rigid_body, sapien_object


@dataclass(frozen=True, kw_only=True)
class Snapshot:
    """State of the simulator as used by the skills; batched, N rows.

    Attributes:
        arm_qpos_rad: (N, A) arm joints.
        fingers_m: (N, F) joints of fingers that grasp by friction; F is 0 with the snap grasp.
        base: (N, 3) x [m], y [m], yaw [rad] of the base in the world.
        base_axes: (N, 3, 3) axes of the base frame in the world, as columns.
        ee_m: (N, 3) end-effector point in the world.
        ee_in_base_m: (N, 3) the same point in the base frame.
        ee_axes: (N, 3, 3) axes of the gripper in the world, as columns.
        objects_m: (N, K, 3) centres of mass of the objects to rearrange, in the world.
        handles_m: (N, J, 3) handles of the required doors and drawers, in the world.
        joints: (N, J) their joint positions [m or rad].
        held: (N,) index of the held object, -1 where none.
        held_handle: (N,) index of the held handle, -1 where none.
        lost: (N,) whether the held object was pulled out of the hand in this step.
        force_n: (N,) contact force on the robot, mean over the control step (see `ContactForce`).
    """

    arm_qpos_rad: Floats
    fingers_m: Floats
    base: Floats
    base_axes: Floats
    ee_m: Floats
    ee_in_base_m: Floats
    ee_axes: Floats
    objects_m: Floats
    handles_m: Floats
    joints: Floats
    held: Ints
    held_handle: Ints
    lost: Bools
    force_n: Floats

    @staticmethod
    def width(arm: int, fingers: int, objects: int, articulations: int) -> int:
        """Returns the number of columns of `of_table`."""
        return arm + fingers + _FIXED + 3 * objects + 4 * articulations

    @staticmethod
    def of_table(
        table: Floats, arm: int, fingers: int, objects: int, articulations: int, **others: Batch
    ) -> Snapshot:
        """Returns views of a table (N, `width`), which `SnapshotReader.read` fills row by row.

        `others` are held, held_handle, lost and force_n.
        """
        # Columns after the joints', as `read` fills them: base 0 to 2, end-effector 3 to 5, its
        # axes 6 to 14, the end-effector in the base frame 15 to 17, the base's axes 18 to 26.
        count, fixed = len(table), table[:, arm + fingers :]
        ends = _FIXED + 3 * objects, _FIXED + 3 * (objects + articulations)
        return Snapshot(
            arm_qpos_rad=table[:, :arm],
            fingers_m=table[:, arm : arm + fingers],
            base=fixed[:, :3],
            base_axes=fixed[:, 18:27].reshape(count, 3, 3),
            ee_m=fixed[:, 3:6],
            ee_in_base_m=fixed[:, 15:18],
            ee_axes=fixed[:, 6:15].reshape(count, 3, 3),
            objects_m=fixed[:, _FIXED : ends[0]].reshape(count, objects, 3),
            handles_m=fixed[:, ends[0] : ends[1]].reshape(count, articulations, 3),
            joints=fixed[:, ends[1] :],
            **others,
        )


_FIXED = 27
"""Columns of a table between joints and objects: base, its frame and the end-effector."""


class SnapshotReader:
    """Reads the robot, and the required objects and handles, of one simulation."""

    def __init__(self, agent: MobileManipulator, grasp: Grasp) -> None:
        self._robot = sapien_object(agent.robot)
        self._ee_link = sapien_object(agent.ee_link)
        fingers = [agent.joint_index[name] for name in agent.spec.finger_joints]
        arm = agent.arm_index.tolist() + fingers
        self._joints, self._arm = arm + agent.base_index.tolist(), len(arm)
        self._ee_offset_m = agent.spec.ee_offset_m
        self._bodies = [(rigid_body(a), rigid_body(a).cmass_local_pose) for a in grasp.objects]
        self._handles = grasp.handles

    def read(self, targets: Sequence[int], handles: Sequence[int], now: Floats) -> None:
        """Reads the simulation into one row `now` (`Snapshot.width`,) of a table.

        `targets` (K,) and `handles` (J,) are grasp indices.
        """
        qpos = self._robot.get_qpos()
        matrix = self._ee_link.entity_pose.to_transformation_matrix()
        articulations = len(handles)
        now[: len(self._joints)] = qpos[self._joints]
        fixed = now[self._arm :]
        fixed[3:6] = matrix[:3, 3] + self._ee_offset_m * matrix[:3, 0]
        fixed[6:15] = matrix[:3, :3].reshape(-1)
        # Python's numbers from here: an array costs more than the arithmetic.
        base_x, base_y, yaw, ee_x, ee_y, ee_z = fixed[:6].tolist()
        x, y, cosine, sine = ee_x - base_x, ee_y - base_y, math.cos(yaw), math.sin(yaw)
        ee_in_base = cosine * x + sine * y, cosine * y - sine * x, ee_z
        # The base only turns about z, so that its axes follow from the yaw.
        fixed[15:27] = *ee_in_base, cosine, -sine, 0.0, sine, cosine, 0.0, 0.0, 0.0, 1.0
        at = _FIXED
        for index in targets:
            body, com = self._bodies[index]
            fixed[at : at + 3] = (body.entity_pose * com).p
            at += 3
        for number, index in enumerate(handles):
            fixed[at : at + 3] = self._handles[index].pose().p
            # From the end of the row, where the joints stand behind all handles.
            fixed[number - articulations] = self._handles[index].joint()
            at += 3


def world_to_base(base: Floats, points_m: Floats) -> Floats:
    """Maps world points (N, P, 3) to the base frames (N, 3: x, y, yaw); heights are kept."""
    yaw = base[:, 2:3]
    cosine, sine = np.cos(yaw), np.sin(yaw)
    x, y = points_m[:, :, 0] - base[:, :1], points_m[:, :, 1] - base[:, 1:2]
    return np.stack((cosine * x + sine * y, cosine * y - sine * x, points_m[:, :, 2]), axis=2)


class ContactForce:
    """C_t: contact force on the robot's links in a control step, held object excluded.

    With a grasp by friction, what the fingers press on objects, doors and drawers is excluded.

    Magnitudes of all contact impulses on the robot [N s], summed over links and over the physics
    steps of one action, divided by the action's duration [s]: a mean force [N].
    """

    def __init__(self, agent: MobileManipulator) -> None:
        self._px: Any = agent.scene.px
        self._links = {sapien_object(link) for link in agent.robot.links}
        grips = agent.spec.fingers is not None
        names = agent.spec.finger_links if grips else ()
        self._fingers: set[Any] = {sapien_object(agent.link(name)) for name in names}
        self._others = self._links - self._fingers
        self._impulse_n_s = 0.0

    def clear(self) -> None:
        """Starts a new control step."""
        self._impulse_n_s = 0.0

    def add_physics_step(self) -> None:
        """Adds the contacts of the physics step that just ended."""
        apart = self._links.isdisjoint
        for contact in self._px.get_contacts():
            # The engine filters contacts between a robot and what is snapped to its hand.
            bodies = contact.bodies
            if not apart(bodies) and not self._is_grip(bodies):
                for point in contact.points:
                    # Magnitudes are summed: of a link that is squeezed, the vectors would cancel.
                    x, y, z = point.impulse.tolist()
                    self._impulse_n_s += (x * x + y * y + z * z) ** 0.5

    def _is_grip(self, bodies: Sequence[Any]) -> bool:
        """Whether a finger that grasps by friction touches what it could hold."""
        return not self._fingers.isdisjoint(bodies) and not any(
            isinstance(body, PhysxRigidStaticComponent) or body in self._others for body in bodies
        )

    def points_m(self) -> Floats:
        """Returns where the robot pressed on other bodies in the latest physics step, (C, 3)."""
        apart = self._links.isdisjoint
        found = [
            point.position
            for contact in self._px.get_contacts()
            if not apart(contact.bodies)
            for point in contact.points
            if point.impulse.any()
        ]
        return np.array(found, dtype=float).reshape(-1, 3)

    def deepest_m(self) -> float:
        """Returns how deep the robot is in another body after the latest physics step [m]."""
        apart = self._links.isdisjoint
        depths = (
            # PhysX's separation is negative inside.
            -point.separation
            for contact in self._px.get_contacts()
            if not apart(contact.bodies)
            for point in contact.points
        )
        return max(depths, default=0.0)

    def newton(self) -> float:
        """Returns the mean force [N] since `clear`."""
        return self._impulse_n_s * CONTROL_HZ
