"""Grasp by friction: two fingers close on objects and handles, and hold them by contact alone.

What both fingers press on is held, as in ManiSkill's `is_grasping`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from mani_skill.utils.structs import Actor
from sapien.physx import PhysxMaterial
from torch import Tensor

from hab_tasks.constants import GRASP_RADIUS_M, SIM_HZ
from hab_tasks.robots.grasp import NOTHING, Grasp
from hab_tasks.robots.handle import Handle
from hab_tasks.robots.mobile_manipulator import MobileManipulator
from hab_tasks.robots.spec import Fingers
from hab_tasks.simulator import sapien_object

LEAST_N = 0.5
"""Force of each finger from which a body is held (ManiSkill's `is_grasping`)."""


class FrictionGrasp(Grasp):
    """The grasp of a robot with driven fingers."""

    def __init__(
        self,
        agent: MobileManipulator,
        objects: list[Actor],
        handles: list[Handle],
        fingers: Fingers,
    ) -> None:
        """Gives the fingers their friction."""
        super().__init__(agent, objects, handles)
        self._spec, self._controller = fingers, agent.controller
        self._px: Any = agent.scene.px
        self._robot = sapien_object(agent.robot)
        self._joints = [agent.joint_index[name] for name in fingers.joints]
        links: list[Any] = [sapien_object(agent.link(name)) for name in agent.spec.finger_links]
        self._numbers = {link: number for number, link in enumerate(links)}
        pads = PhysxMaterial(fingers.friction, fingers.friction, 0.0)
        for link in links:
            for shape in link.collision_shapes:
                shape.set_physical_material(pads)
        self._index = {body: index for index, (body, _) in enumerate(self._bodies)}
        self._closes = False

    def reset(self) -> None:
        """Opens the fingers."""
        self.held, self.held_handle, self.lost = NOTHING, NOTHING, False
        self._close(False)

    def command(self, gripper: float) -> None:
        """Closes (>= 0) or opens (< 0) the fingers."""
        self.lost = False
        self._close(gripper >= 0)

    def attach(self, index: int) -> None:
        """Closes the fingers on an object that is between them."""
        qpos = self._robot.qpos
        qpos[self._joints] = self._half_width_m(index)
        self._robot.set_qpos(qpos)
        self.held = index
        self._close(True)

    def after_control_step(self) -> None:
        """Looks what both fingers press on."""
        before = self.held, self.held_handle
        pressed_n = self._pressed_n() if self._closes else {}
        held = {body for body, force_n in pressed_n.items() if min(force_n) >= LEAST_N}
        objects = [self._index[body] for body in held if body in self._index]
        # The first of several, as the order of a set of bodies differs between processes.
        self.held = min(objects, default=NOTHING)
        self.held_handle = NOTHING if objects else self._handle_of(held)
        self.lost = self._closes and before != (NOTHING, NOTHING) and not self.holding

    def get_state(self) -> dict[str, Tensor]:
        """Returns held, held_handle (1,), and whether the fingers close (1,)."""
        return {
            "held": torch.tensor([self.held]),
            "held_handle": torch.tensor([self.held_handle]),
            "closes": torch.tensor([self._closes]),
        }

    def set_state(self, state: Mapping[str, Tensor]) -> None:
        """Restores a state of `get_state`."""
        self.held, self.held_handle = int(state["held"][0]), int(state["held_handle"][0])
        self.lost = False
        self._close(bool(state["closes"][0]))

    def _close(self, closes: bool) -> None:
        self._closes = closes
        self._controller.move_fingers(-self._spec.squeeze_m if closes else self._spec.open_m)

    def _pressed_n(self) -> dict[Any, list[float]]:
        """Returns the force of each finger on other bodies in the latest physics step."""
        found: dict[Any, list[float]] = {}
        for contact in self._px.get_contacts():
            body, other = contact.bodies
            if other in self._numbers:
                body, other = other, body
            number = self._numbers.get(body)
            if number is None or other in self._numbers:
                continue
            impulse_n_s = np.sum([point.impulse for point in contact.points], axis=0)
            forces_n = found.setdefault(other, [0.0, 0.0])
            forces_n[number] += float(np.linalg.norm(impulse_n_s)) * SIM_HZ
        return found

    def _handle_of(self, held: set[Any]) -> int:
        """Returns the handle of furniture that is held near it."""
        for index, handle in enumerate(self.handles):
            gap_m = np.linalg.norm(handle.pose().p - self._hand.entity_pose.p)
            if handle.body in held and gap_m <= GRASP_RADIUS_M:
                return index
        return NOTHING

    def _half_width_m(self, index: int) -> float:
        """Returns the joint position at which the fingers touch an object between them."""
        hand_from_object = self._hand.entity_pose.inv() * self._bodies[index][0].entity_pose
        frame = hand_from_object.to_transformation_matrix()
        low_m, high_m = self._spec.depth_m
        widths_m = [0.0]
        for shape in self._bodies[index][0].collision_shapes:
            local = frame @ shape.local_pose.to_transformation_matrix()
            points_m = shape.vertices * shape.scale @ local[:3, :3].T + local[:3, 3]
            between = (points_m[:, 0] > low_m) & (points_m[:, 0] < high_m)
            widths_m += np.abs(points_m[between, 1]).tolist()
        return min(max(widths_m), self._spec.open_m)
