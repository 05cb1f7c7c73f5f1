"""The snap grasp of the CPU simulation: constraints tie what is held to the gripper."""

from __future__ import annotations

from typing import Any

import numpy as np
import sapien

from hab_tasks.constants import SIM_HZ
from hab_tasks.robots.carried import inertia_at, pull_along, take_along
from hab_tasks.robots.fetch_spec import EE_OFFSET_M
from hab_tasks.robots.grasp import NOTHING, SnapGrasp
from hab_tasks.robots.handle_tie import HANDLE_SPRING

HOLD_STIFFNESS_NM_RAD = 1e5
HOLD_DAMPING_NM_S_RAD = 1e3


class DriveGrasp(SnapGrasp):
    """Holds with a constraint: a rigid joint for an object, a spring of limited force for a handle.

    Attributes:
        pulls_along: Whether the furniture of a held handle goes where the hand is set, instead of
            being tied to it: an arm that is set at once would be thrown back by its weight.
    """

    def __init__(self, *args: Any, pulls_along: bool = False) -> None:
        super().__init__(*args)
        self.pulls_along = pulls_along
        self._ties: dict[int, tuple[sapien.Entity, Any]] = {}
        self._cpu_hand = self.ee_link._objs[0]
        self._hand_before = sapien.Pose()
        self._steps_left, self._inertia = 0, 0.0

    def carry(self, physics_steps: int) -> None:
        """Moves a held object with the hand, and lets a held handle follow it."""
        super().carry(physics_steps)
        held = int(self.held[0])
        if held != NOTHING:
            take_along(self._cpu_bodies[held][0], self._cpu_hand, self._hand_before)
        self._steps_left = physics_steps if self.pulls_along else 0

    def before_simulation_step(self) -> None:
        """Moves the furniture of a held handle to a hand that was set."""
        if self._steps_left and int(self.held_handle[0]) != NOTHING:
            handle = self.handles[int(self.held_handle[0])]
            world_from_ee = self._cpu_hand.entity_pose * sapien.Pose([EE_OFFSET_M, 0.0, 0.0])
            place_m = np.asarray((world_from_ee * sapien.Pose(self._handle_in_ee_m[0])).p)
            pull_along(handle, place_m, self._steps_left, self._inertia)
            self._steps_left -= 1

    def after_control_step(self) -> None:
        """Loses what has been pulled out of the hand, and keeps where the hand is."""
        super().after_control_step()
        if self._busy:
            self._hand_before = self._cpu_hand.entity_pose

    def _tie_object(self, row: int, index: int) -> None:
        self._hand_before = self._cpu_hand.entity_pose
        pose = self._ee_from_object[row].sp
        drive = self._drive(row, pose, self.objects[index]._objs[row], sapien.Pose())
        for lock in (drive.set_limit_x, drive.set_limit_y, drive.set_limit_z):
            lock(0.0, 0.0)
        # Angular limits of zero do not hold against an articulation's link (measured: 50 degrees).
        drive.set_drive_property_slerp(HOLD_STIFFNESS_NM_RAD, HOLD_DAMPING_NM_S_RAD)
        self.objects[index]._bodies[row].wake_up()

    def _tie_handle(self, row: int, index: int) -> None:
        handle = self.handles[index]
        in_ee = sapien.Pose([EE_OFFSET_M, 0, 0])
        drive = self._drive(
            row, in_ee, handle.link._objs[row].entity, sapien.Pose(list(handle.offset_m))
        )
        if self.pulls_along:  # tied bodies do not collide, and that is all
            self._inertia = inertia_at(handle)
            return
        spring = HANDLE_SPRING
        # SAPIEN limits the impulse of a physics step, and calls it a force (measured).
        most_n_s = spring.force_n / SIM_HZ
        for pull in (
            drive.set_drive_property_x,
            drive.set_drive_property_y,
            drive.set_drive_property_z,
        ):
            pull(spring.stiffness_n_m, spring.damping_n_s_m, most_n_s)
        self._retie_handle(row)

    def _retie_handle(self, row: int) -> None:
        self._ties[row][1].set_drive_target(sapien.Pose(self._handle_in_ee_m[row]))

    def _drive(
        self, row: int, pose0: sapien.Pose, entity: sapien.Entity, pose1: sapien.Pose
    ) -> Any:
        gripper = self.ee_link._objs[row].entity
        drive = self.scene.sub_scenes[row].create_drive(gripper, pose0, entity, pose1)
        self._ties[row] = (drive.entity, drive)
        return drive

    def _untie(self, row: int) -> None:
        entity, drive = self._ties.pop(row)
        entity.remove_component(drive)
