"""Snap grasp (S E.3): objects and handles close to the end-effector are held until released.

A held object keeps its pose in the gripper from the start of the grasp. It does not collide with
the robot until it is released and clear of the hand; it always collides with the world. Nothing is
grasped through furniture or out of a closed container.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import sapien
import torch
from mani_skill.utils.structs import Actor
from torch import Tensor

from hab_tasks.arrays import Floats
from hab_tasks.constants import GRASP_RADIUS_M
from hab_tasks.robots.grasp import NOTHING, Grasp
from hab_tasks.robots.handle import HANDLE_SPRING, Handle, HandlePassage
from hab_tasks.robots.hidden_objects import LineOfSight
from hab_tasks.robots.mobile_manipulator import MobileManipulator
from hab_tasks.robots.tie import Tie
from hab_tasks.simulator import rigid_body
from hab_tasks.world.scenes.physics import HELD, MOVING, set_groups

HOLD_TOLERANCE_M = 0.09
"""Displacement at which a held object is lost (Habitat's hold threshold)."""

HANDLE_TOLERANCE_M = GRASP_RADIUS_M + HOLD_TOLERANCE_M
"""Distance to a held handle at which a hand that is set directly releases it."""


class SnapGrasp(Grasp):
    """The snap grasp of one robot; handles are grasped if no object is within range."""

    def __init__(
        self,
        agent: MobileManipulator,
        objects: list[Actor],
        handles: list[Handle],
        takes: str = "any",
        *,
        pulls_along: bool = False,
    ) -> None:
        """Grasps ``objects``, ``handles``, or ``any``: an object if in range, else a handle.

        `pulls_along`: see `Tie`.
        """
        super().__init__(agent, objects, handles)
        self.takes = takes
        self._ee_link = agent.ee_link
        self._ee_from_object = sapien.Pose()
        self._handle_in_ee_m: Floats = np.zeros(3, dtype=np.float32)
        self._steps_apart = 0
        self._leaving_m: dict[int, float] = {}
        self._passage = HandlePassage([handle.body for handle in handles], self._handle_gap_m)
        self._sight = LineOfSight(agent)
        self._tie = Tie(agent, pulls_along=pulls_along)

    def reset(self) -> None:
        """Releases without physics, and restores all contacts."""
        self._release()
        for index in self._leaving_m:
            set_groups(self._bodies[index][0], MOVING)
        self._leaving_m = {}
        self._passage.close()

    def command(self, gripper: float) -> None:
        """Executes the gripper action: >= 0 grasps if the hand is empty, < 0 releases."""
        # What slipped out is grasped again at once, as long as the action still grasps.
        self.lost = False
        if (gripper >= 0) != self.holding:
            if self.holding:
                self._release()
            else:
                self._grasp()
        if self._leaving_m:
            self._restore_collisions()

    def attach(self, index: int) -> None:
        """Grasps object `index` at any distance."""
        self._hold(index, (self._ee_link.pose.inv() * self.objects[index].pose).sp)

    def carry(self) -> None:
        """Moves what is held after joint states were set, before the next physics step.

        A handle that is then too far from the hand is released.
        """
        handle = self.held_handle
        if handle != NOTHING and self._handle_gap_m(handle) > HANDLE_TOLERANCE_M:
            self._lose()
        self._tie.carry()

    def before_physics_step(self) -> None:
        """Moves the furniture of a held handle to a hand whose state was set."""
        self._tie.before_physics_step(self._handle_in_ee_m)

    def after_control_step(self) -> None:
        """Releases what was pulled out of the hand, after the physics of an action."""
        if self.held_handle != NOTHING:
            self._draw_in()
        elif self.held != NOTHING and self._drift_m() > HOLD_TOLERANCE_M:
            self._lose()
        if self._passage.is_open:
            self._passage.close_behind(self.held_handle)
        self._tie.after_control_step()

    def get_state(self) -> dict[str, Tensor]:
        """Returns held, held_handle (1,), how they are held, and objects leaving the hand.

        An object is held by its pose in the hand (1, 7), a handle by its position in the hand
        (1, 3) [m] and the number of actions (1,) for which it was out of reach; all 0 for what is
        not held. Objects leaving the hand (1, K): distance [m] at which each is clear of the hand,
        0 if it already is. Doors and drawers that the hand passes through: (1, H) bool.
        """
        leaving_m = torch.zeros(1, len(self.objects))
        for index, side_m in self._leaving_m.items():
            leaving_m[0, index] = side_m
        pose = torch.from_numpy(np.concatenate((self._ee_from_object.p, self._ee_from_object.q)))
        # Of an empty hand, the last pose is left out: equal situations have equal states.
        object_held, handle_held = self.held != NOTHING, self.held_handle != NOTHING
        return {
            "held": torch.tensor([self.held]),
            "held_handle": torch.tensor([self.held_handle]),
            "ee_from_object": pose[None] * object_held,
            "handle_in_ee_m": torch.tensor(self._handle_in_ee_m)[None] * handle_held,
            "steps_apart": torch.tensor([self._steps_apart]) * handle_held,
            "leaving_m": leaving_m,
            "passed": self._passage.state(),
        }

    def set_state(self, state: Mapping[str, Tensor]) -> None:
        """Restores a state of `get_state`, after the bodies' poses were restored."""
        # Constraint and collision groups are no part of the simulator's state: they are made anew.
        self.reset()
        held, handle = int(state["held"][0]), int(state["held_handle"][0])
        if held != NOTHING:
            pose = state["ee_from_object"][0].tolist()
            self._hold(held, sapien.Pose(pose[:3], pose[3:]))
        elif handle != NOTHING:
            self._hold_handle(handle, state["handle_in_ee_m"][0].numpy().astype(np.float32))
            self._steps_apart = int(state["steps_apart"][0])
        for index in torch.nonzero(state["leaving_m"][0]).flatten().tolist():
            self._leaving_m[index] = float(state["leaving_m"][0, index])
            set_groups(self._bodies[index][0], HELD)
        for index in torch.nonzero(state["passed"][0]).flatten().tolist():
            self._passage.open(index)

    def awake_in(self, state: Mapping[str, Tensor]) -> list[int]:
        """Returns the held object, and those that leave the hand."""
        return super().awake_in(state) + torch.nonzero(state["leaving_m"][0]).flatten().tolist()

    def _grasp(self) -> None:
        """Grasps the nearest object in range, else the nearest handle."""
        ee_m = self.ee_position_m()
        if self.takes != "handles":
            for index in _in_range(ee_m, self.objects_com_m()):
                # Asked of those in range only, as it casts a ray.
                if not self._is_hidden(index, ee_m):
                    self.attach(index)
                    return
        if self.takes != "objects":
            # In plain numbers, as a hand that wants to grasp asks in every step.
            gaps_m = [math.dist(ee_m, handle.pose().p) for handle in self.handles]
            if min(gaps_m, default=math.inf) <= GRASP_RADIUS_M:
                index = gaps_m.index(min(gaps_m))
                self._hold_handle(index, self._place_in_ee_m(index))

    def _is_hidden(self, index: int, ee_m: Floats) -> bool:
        """Whether an object is in a closed container, or furniture is between it and the hand."""
        enclosed = self.is_enclosed()
        if enclosed is not None and enclosed[index]:
            return True
        return self._sight.is_blocked(ee_m, self.objects_com_m()[index])

    def _hold(self, index: int, ee_from_object: sapien.Pose) -> None:
        self.held, self._ee_from_object = index, ee_from_object
        body = self._bodies[index][0]
        set_groups(body, HELD)
        self._tie.hold_object(body, ee_from_object)

    def _hold_handle(self, index: int, place_m: Floats) -> None:
        """Grasps a handle at a position (3,) in the hand."""
        self.held_handle, self._handle_in_ee_m, self._steps_apart = index, place_m, 0
        self._passage.open(index)
        self._tie.hold_handle(self.handles[index], place_m)

    def _draw_in(self) -> None:
        """Draws the held handle towards the hand; releases it if it stays out of reach."""
        far = self._handle_gap_m(self.held_handle) > HANDLE_SPRING.reach_m
        self._steps_apart = self._steps_apart + 1 if far else 0
        if self._steps_apart >= HANDLE_SPRING.lost_steps:
            self._lose()
        elif self._handle_in_ee_m.any():
            self._handle_in_ee_m = HANDLE_SPRING.drawn_in(self._handle_in_ee_m)
            self._tie.draw_in(self._handle_in_ee_m)

    def _handle_gap_m(self, index: int) -> float:
        """Returns the distance of a handle to the hand."""
        return float(np.linalg.norm(self._place_in_ee_m(index)))

    def _place_in_ee_m(self, index: int) -> Floats:
        """Returns a handle's position (3,) in the end-effector's frame."""
        world_from_ee = self._hand.entity_pose * self._link_from_ee
        return np.asarray((world_from_ee.inv() * self.handles[index].pose()).p)

    def _lose(self) -> None:
        self._release()
        self.lost = True

    def _release(self) -> None:
        if self.held != NOTHING:
            # Habitat's rule: no contact with the robot until it is farther off than its largest
            # side.
            self._leaving_m[self.held] = _largest_side_m(self.objects[self.held])
        if self.holding:
            self._tie.release()
        self.held = self.held_handle = NOTHING

    def _drift_m(self) -> float:
        """Returns how far the held object is from its place in the hand."""
        body = self._bodies[self.held][0]
        held = self._hand.entity_pose * self._ee_from_object
        gap: Any = np.subtract(held.p, body.entity_pose.p)
        return math.sqrt(float(gap @ gap))

    def _restore_collisions(self) -> None:
        """Lets objects that are clear of the hand collide with the robot again."""
        ee_m = self.ee_position_m()
        for index, side_m in list(self._leaving_m.items()):
            body, com = self._bodies[index]
            if index == self.held:  # grasped again before it was clear of the hand
                del self._leaving_m[index]
            elif np.linalg.norm((body.entity_pose * com).p - ee_m) >= side_m:
                del self._leaving_m[index]
                set_groups(body, MOVING)


def _in_range(ee_m: Floats, points_m: Floats) -> list[int]:
    """Returns which points (K, 3) the hand at (3,) grasps, the nearest first."""
    away = points_m - ee_m
    gap_m = np.sqrt(np.einsum("ki,ki->k", away, away))
    near = np.flatnonzero(gap_m <= GRASP_RADIUS_M)
    return near[np.argsort(gap_m[near], kind="stable")].tolist()


def _largest_side_m(actor: Actor) -> float:
    low, high = rigid_body(actor).compute_global_aabb_tight()
    return float(np.max(np.asarray(high) - np.asarray(low)))
