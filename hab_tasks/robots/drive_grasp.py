"""Snap grasp of the CPU simulation, by constraints between gripper and held body."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import sapien
import torch
from torch import Tensor

from hab_tasks.constants import GRASP_RADIUS_M, SIM_HZ
from hab_tasks.robots.grasp import EE_FROM_LINK, NOTHING, SnapGrasp
from hab_tasks.robots.handle_passage import HandlePassage
from hab_tasks.robots.handle_tie import HANDLE_SPRING
from hab_tasks.robots.held_object import inertia_at, move_held_object, pull_along
from hab_tasks.robots.line_of_sight import LineOfSight
from hab_tasks.robots.robot import ROBOT
from hab_tasks.simulator import sapien_object

NEARLY_M = 1e-3
"""Margin of a quick test of distances, far above rounding errors."""

HOLD_STIFFNESS_NM_RAD = 1e5
HOLD_DAMPING_NM_S_RAD = 1e3


class DriveGrasp(SnapGrasp):
    """Holds with a constraint: a rigid joint for objects, a force-limited spring for handles.

    Attributes:
        pulls_along: Whether a held handle follows the hand kinematically instead of by a spring,
            as the furniture's inertia would throw back an arm whose state is set directly.
    """

    def __init__(self, *args: Any, pulls_along: bool = False) -> None:
        super().__init__(*args)
        self.pulls_along = pulls_along
        self._ties: dict[int, tuple[sapien.Entity, Any]] = {}
        self._cpu_hand = sapien_object(self.ee_link)
        self._hand_before = sapien.Pose()
        self._pulls_now, self._inertia = False, 0.0
        links = [link for link, _ in self._cpu_handles]
        self._passage = HandlePassage(links, partial(self._handle_gap_m, 0))
        self._sight = LineOfSight(self.scene, self.ee_link)

    def carry(self) -> None:
        """Moves a held object or handle with the hand."""
        super().carry()
        held = int(self.held[0])
        if held != NOTHING:
            move_held_object(self._cpu_bodies[held][0], self._cpu_hand, self._hand_before)
            self._hand_before = self._cpu_hand.entity_pose
        self._pulls_now = self.pulls_along

    def reset(self, rows: Tensor) -> None:
        """Releases in `rows` (R,) without physics, and restores all contacts."""
        super().reset(rows)
        self._passage.close()

    def get_state(self) -> dict[str, Tensor]:
        """Adds which doors and drawers the hand passes through, (N, H) bool."""
        return {**super().get_state(), "passed": self._passage.state()}

    def set_state(self, state: dict[str, Tensor], rows: Tensor) -> None:
        """Restores a state of `get_state`, after the bodies' poses were restored."""
        super().set_state(state, rows)
        for index in torch.nonzero(state["passed"][0]).flatten().tolist():
            self._passage.open(index)

    def before_simulation_step(self) -> None:
        """Moves the furniture of a held handle to a hand whose state was set."""
        if self._pulls_now and int(self.held_handle[0]) != NOTHING:
            handle = self.handles[int(self.held_handle[0])]
            world_from_ee = self._cpu_hand.entity_pose * sapien.Pose([ROBOT.ee_offset_m, 0.0, 0.0])
            place_m = np.asarray((world_from_ee * sapien.Pose(self._handle_in_ee_m[0])).p)
            pull_along(handle, place_m, self._inertia)
            self._pulls_now = False

    def after_control_step(self) -> None:
        """Releases what was pulled out of the hand, and stores the hand's pose."""
        super().after_control_step()
        if self._passage.is_open:
            self._passage.close_behind(int(self.held_handle[0]))
        if self._busy:
            self._hand_before = self._cpu_hand.entity_pose

    def _may_change(self) -> bool:
        """Whether anything is held or within reach; spares most commands the tensors."""
        if self._busy or self.known_com_m is None:
            return True
        x, y, z = (self._cpu_hand.entity_pose * EE_FROM_LINK).p.tolist()
        points = self.known_com_m.tolist() if self.takes != "handles" else []
        if self.takes != "objects":
            points += [(link.entity_pose * offset).p.tolist() for link, offset in self._cpu_handles]
        near_m2 = (GRASP_RADIUS_M + NEARLY_M) ** 2
        return any((a - x) ** 2 + (b - y) ** 2 + (c - z) ** 2 < near_m2 for a, b, c in points)

    def _hidden(self, ee: Tensor, points: Tensor) -> Tensor:
        hidden = torch.linalg.norm(points - ee[:, None], dim=2) <= GRASP_RADIUS_M
        for index in torch.nonzero(hidden[0]).flatten().tolist():
            hidden[0, index] = self._sight.is_blocked(ee[0].numpy(), points[0, index].numpy())
        return hidden

    def _tie_object(self, row: int, index: int) -> None:
        self._hand_before = self._cpu_hand.entity_pose
        pose = self._ee_from_object[row].sp
        drive = self._drive(row, pose, self.objects[index]._objs[row], sapien.Pose())
        for lock in (drive.set_limit_x, drive.set_limit_y, drive.set_limit_z):
            lock(0.0, 0.0)
        # Zero angular limits do not hold against an articulation link (measured: 50 degrees).
        drive.set_drive_property_slerp(HOLD_STIFFNESS_NM_RAD, HOLD_DAMPING_NM_S_RAD)
        self.objects[index]._bodies[row].wake_up()

    def _tie_handle(self, row: int, index: int) -> None:
        handle = self.handles[index]
        self._passage.open(index)
        in_ee = sapien.Pose([ROBOT.ee_offset_m, 0, 0])
        drive = self._drive(
            row, in_ee, sapien_object(handle.link, row).entity, sapien.Pose(list(handle.offset_m))
        )
        if self.pulls_along:  # `pull_along` moves the furniture; the constraint has no spring
            self._inertia = inertia_at(handle)
            return
        spring = HANDLE_SPRING
        # SAPIEN's force limit is an impulse per physics step (measured).
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
        gripper = sapien_object(self.ee_link, row).entity
        drive = self.scene.sub_scenes[row].create_drive(gripper, pose0, entity, pose1)
        self._ties[row] = (drive.entity, drive)
        return drive

    def _untie(self, row: int) -> None:
        entity, drive = self._ties.pop(row)
        entity.remove_component(drive)
