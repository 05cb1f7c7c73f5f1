"""Snap grasp (S E.3): objects and handles close to the end-effector are held until released.

`SnapGrasp` decides what is grasped. Two implementations hold it: `DriveGrasp` (in
`hab_tasks.robots.drive_grasp`) attaches the body to the gripper with a constraint (CPU simulation);
`FollowGrasp` (in `hab_tasks.robots.follow_grasp`) moves it with the gripper, using only batched
poses.

A held object keeps its pose in the gripper from the start of the grasp. It does not collide with
the robot until it is released and clear of the hand; it always collides with the world.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import sapien
import torch
from mani_skill.envs.scene import ManiSkillScene
from mani_skill.utils.structs import Actor, Articulation, Link
from mani_skill.utils.structs.pose import Pose
from numpy.typing import NDArray
from torch import Tensor

from hab_tasks.arrays import BatchArray
from hab_tasks.constants import GRASP_RADIUS_M
from hab_tasks.robots.handle_tie import HANDLE_SPRING
from hab_tasks.robots.robot import ROBOT
from hab_tasks.scenes.collision_groups import HELD, MOVING, Groups, set_groups
from hab_tasks.simulator import rigid_body, sapien_object

HOLD_TOLERANCE_M = 0.09
"""Displacement at which a held object is lost (Habitat's hold threshold)."""

NOTHING = -1

HANDLE_TOLERANCE_M = GRASP_RADIUS_M + HOLD_TOLERANCE_M
"""Distance to a held handle at which a hand that is set directly releases it."""

FAR_AWAY_M = 1e6

EE_FROM_LINK = sapien.Pose([ROBOT.ee_offset_m, 0.0, 0.0])


@dataclass(frozen=True, kw_only=True)
class Handle:
    """A handle marker on a built piece of furniture."""

    name: str
    furniture_name: str
    furniture: Articulation
    link: Link
    offset_m: tuple[float, float, float]

    @property
    def column(self) -> int:
        """Index of the handle's joint in the furniture's active joints."""
        joint: Any = self.link.joint
        return int(joint.active_index[0])

    @property
    def limits(self) -> tuple[float, float]:
        """Limits of the handle's joint [m or rad]."""
        lower, upper = sapien_object(self.furniture).active_joints[self.column].limits[0].tolist()
        return lower, upper


class SnapGrasp:
    """Grasp state of each row, and the rules of grasping and releasing.

    Attributes:
        objects: All graspable objects, in a fixed order.
        handles: Handle markers, used if no object is within range.
        held: (N,) index into `objects`, `NOTHING` without one. Replaced, never modified in place.
        held_handle: (N,) index into `handles`, `NOTHING` without one.
        lost: (N,) whether the held object or handle slipped away since the last command.
        is_enclosed: Returns which objects (N, K) are in closed containers; None if unknown.
        known_com_m: (K, 3) centres of mass kept current by the caller; None to read each.
    """

    def __init__(
        self,
        scene: ManiSkillScene,
        ee_link: Link,
        objects: list[Actor],
        handles: list[Handle],
        takes: str = "any",
    ) -> None:
        """Grasps ``objects``, ``handles``, or ``any``: an object if in range, else a handle."""
        self.scene, self.ee_link = scene, ee_link
        self.objects, self.handles, self.takes = objects, handles, takes
        self.is_enclosed: Callable[[], Tensor | None] | None = None
        self.known_com_m: NDArray[np.float32] | None = None
        count, device = scene.num_envs, scene.device
        self.held = torch.full((count,), NOTHING, dtype=torch.long, device=device)
        self.held_handle = self.held.clone()
        self.lost = torch.zeros(count, dtype=torch.bool, device=device)
        self._any_lost = False
        self._ee_from_object = Pose.create_from_pq(torch.zeros(count, 3, device=device))
        self._handle_in_ee_m = np.zeros((count, 3), dtype=np.float32)
        self._steps_apart = np.zeros(count, dtype=np.int64)
        self._cpu_held = sapien.Pose()
        self._leaving: list[tuple[int, int, float]] = []
        self._busy: set[int] = set()
        bodies = [rigid_body(actor) for actor in objects]
        self._cpu_bodies = [(body, body.cmass_local_pose) for body in bodies]
        self._com_m = [torch.as_tensor(com.p, device=device) for _, com in self._cpu_bodies]
        self._cpu_handles = [
            (sapien_object(h.link), sapien.Pose(list(h.offset_m))) for h in handles
        ]
        self._offset = torch.tensor([ROBOT.ee_offset_m, 0.0, 0.0], device=device)
        link_com = sapien_object(ee_link).cmass_local_pose.p
        self._link_com_m = torch.as_tensor(np.asarray(link_com, dtype=np.float32), device=device)

    @property
    def holding(self) -> Tensor:
        """(N,) whether an object or a handle is held."""
        return (self.held != NOTHING) | (self.held_handle != NOTHING)

    def reset(self, rows: Tensor) -> None:
        """Releases in `rows` (R,) without physics, and clears objects leaving the hand."""
        for row in rows.tolist():
            self._release_row(row)
        started = set(rows.tolist())
        for row, index, _ in self._leaving:
            if row in started:
                self._set_collision(row, index, MOVING)
        self._leaving = [entry for entry in self._leaving if entry[0] not in started]

    def command(self, gripper: BatchArray) -> None:
        """Executes the gripper action (N,): >= 0 grasps if the hand is empty, < 0 releases."""
        if self._any_lost:
            self.lost, self._any_lost = torch.zeros_like(self.lost), False
        if not self._as_wanted(gripper) and self._may_change():
            wants = torch.as_tensor(gripper, device=self.held.device) >= 0
            for row in torch.nonzero(~wants & self.holding).flatten().tolist():
                self._release_row(row)
            rows = torch.nonzero(wants & ~self.holding).flatten()
            if len(rows):
                self._grasp_rows(rows)
        if self._leaving:
            self._restore_collisions()

    def _as_wanted(self, gripper: BatchArray) -> bool:
        if len(gripper) == 1:  # plain numbers: tensor arithmetic would be a tenth of the step
            return (float(gripper[0]) >= 0) == bool(self._busy)
        return bool(((gripper >= 0) == self.holding).all())

    def _may_change(self) -> bool:
        """Whether a command may grasp or release anything."""
        return True

    def attach(self, row: int, index: int) -> None:
        """Grasps object `index` in `row` at any distance."""
        ee_from_object = self.ee_link.pose[row].inv() * self.objects[index].pose[row]
        self._hold(row, index, ee_from_object.raw_pose[0])

    def carry(self) -> None:
        """Moves held objects after joint states were set, before the next physics step.

        A handle that is then too far from the hand is released.
        """
        for row in sorted(self._busy):
            handle = int(self.held_handle[row])
            if handle != NOTHING and self._handle_gap_m(row, handle) > HANDLE_TOLERANCE_M:
                self._lose(row)

    def before_simulation_step(self) -> None:
        """Hook before every physics step."""

    def after_control_step(self) -> None:
        """Hook after the physics of an action; releases what was pulled out of the hand."""
        if self._busy:
            for row in sorted(self._busy):
                if int(self.held[row]) == NOTHING:
                    self._draw_in(row)
                elif self._drift_m(row) > HOLD_TOLERANCE_M:
                    self._lose(row)

    def get_state(self) -> dict[str, Tensor]:
        """Returns held, held_handle (N,), how they are held, and objects leaving the hand.

        An object is held by its pose in the hand (N, 7), a handle by its position in the hand
        (N, 3) [m] and the number of actions (N,) for which it was out of reach; all 0 for what is
        not held. Objects leaving the hand (N, K): distance [m] at which each is clear of the hand,
        0 if it already is.
        """
        object_held, handle_held = self.held != NOTHING, (self.held_handle != NOTHING).cpu()
        leaving_m = torch.zeros(len(self.held), len(self.objects), device=self.held.device)
        for row, index, side_m in self._leaving:
            leaving_m[row, index] = side_m
        return {
            "held": self.held.clone(),
            "held_handle": self.held_handle.clone(),
            "ee_from_object": self._ee_from_object.raw_pose * object_held[:, None],
            "handle_in_ee_m": torch.as_tensor(self._handle_in_ee_m) * handle_held[:, None],
            "steps_apart": torch.as_tensor(self._steps_apart) * handle_held,
            "leaving_m": leaving_m,
        }

    def set_state(self, state: dict[str, Tensor], rows: Tensor) -> None:
        """Restores a state of `get_state`, after the bodies' poses were restored."""
        self.reset(rows)
        for i, row in enumerate(rows.tolist()):
            if int(state["held"][i]) != NOTHING:
                self._hold(row, int(state["held"][i]), state["ee_from_object"][i])
            elif int(state["held_handle"][i]) != NOTHING:
                place_m = state["handle_in_ee_m"][i].cpu().numpy().astype(np.float32)
                self._hold_handle(row, int(state["held_handle"][i]), place_m)
                self._steps_apart[row] = int(state["steps_apart"][i])
            for index in torch.nonzero(state["leaving_m"][i]).flatten().tolist():
                self._leaving.append((row, index, float(state["leaving_m"][i, index])))
                self._set_collision(row, index, HELD)

    def ee_position_m(self) -> Tensor:
        """Returns the end-effector point (N, 3) in the world."""
        if self.scene.gpu_sim_enabled:
            return (self.ee_link.pose * Pose.create_from_pq(self._offset)).p
        point = sapien_object(self.ee_link).entity_pose * EE_FROM_LINK
        return torch.from_numpy(point.p)[None]

    def objects_com_m(self) -> Tensor:
        """Returns every object's centre of mass (N, K, 3) in the world."""
        if self.scene.gpu_sim_enabled:
            return torch.stack([self.object_com_m(i) for i in range(len(self.objects))], dim=1)
        if self.known_com_m is not None:
            return torch.from_numpy(self.known_com_m)[None]
        points = [(body.entity_pose * com).p for body, com in self._cpu_bodies]
        return torch.from_numpy(np.array(points, dtype=np.float32).reshape(1, -1, 3))

    def object_com_m(self, index: int) -> Tensor:
        """Returns the centre of mass (N, 3) of an object in the world."""
        return (self.objects[index].pose * Pose.create_from_pq(self._com_m[index])).p

    def handles_m(self) -> Tensor:
        """Returns every handle marker (N, H, 3) in the world."""
        if self.scene.gpu_sim_enabled:
            return torch.stack([self.handle_position_m(i) for i in range(len(self.handles))], dim=1)
        points = [(link.entity_pose * offset).p for link, offset in self._cpu_handles]
        return torch.from_numpy(np.array(points, dtype=np.float32).reshape(1, -1, 3))

    def handle_position_m(self, index: int) -> Tensor:
        """Returns a handle marker (N, 3) in the world."""
        handle = self.handles[index]
        offset = torch.tensor(handle.offset_m, device=self.scene.device)
        return (handle.link.pose * Pose.create_from_pq(offset)).p

    def _grasp_rows(self, rows: Tensor) -> None:
        ee = self.ee_position_m()[rows]
        nearest, distance = self._nearest_object(ee, rows)
        free = distance > GRASP_RADIUS_M
        if self.takes != "objects" and self.handles and bool(free.any()):
            handle, handle_distance = _nearest(ee, self.handles_m()[rows])
            free = free & (handle_distance <= GRASP_RADIUS_M)
            for i in torch.nonzero(free).flatten().tolist():
                row, index = int(rows[i]), int(handle[i])
                self._hold_handle(row, index, self._place_in_ee_m(row, index))
        for i in torch.nonzero(distance <= GRASP_RADIUS_M).flatten().tolist():
            self.attach(int(rows[i]), int(nearest[i]))

    def _nearest_object(self, ee: Tensor, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Returns index and distance (R,) of the nearest graspable object."""
        points = self.objects_com_m()[rows]
        if self.takes == "handles":
            points = points[:, :0]
        index, distance_m = _nearest(ee, points)
        if not bool((distance_m <= GRASP_RADIUS_M).any()):
            return index, distance_m
        hidden = self._hidden(ee, points)
        if self.is_enclosed is not None and (enclosed := self.is_enclosed()) is not None:
            hidden = hidden | enclosed[rows]
        return _nearest(ee, torch.where(hidden[..., None], FAR_AWAY_M, points))

    def _hidden(self, ee: Tensor, points: Tensor) -> Tensor:
        """Returns which points (R, K, 3) furniture hides from the hands (R, 3), (R, K)."""
        return torch.zeros(points.shape[:2], dtype=torch.bool, device=points.device)

    def _hold(self, row: int, index: int, ee_from_object: Tensor) -> None:
        self.held = _with(self.held, row, index)
        self._busy.add(row)
        self._set_collision(row, index, HELD)
        raw = self._ee_from_object.raw_pose.clone()
        raw[row] = ee_from_object
        self._ee_from_object = Pose.create(raw)
        self._cpu_held = sapien.Pose(raw[row, :3].tolist(), raw[row, 3:].tolist())
        self._tie_object(row, index)

    def _hold_handle(self, row: int, index: int, place_m: NDArray[np.float32]) -> None:
        """Grasps a handle at a position (3,) in the hand."""
        self.held_handle = _with(self.held_handle, row, index)
        self._busy.add(row)
        self._handle_in_ee_m[row], self._steps_apart[row] = place_m, 0
        self._tie_handle(row, index)

    def _draw_in(self, row: int) -> None:
        """Draws the held handle towards the hand; releases it if it stays out of reach."""
        held = int(self.held_handle[row])
        far = self._handle_gap_m(row, held) > HANDLE_SPRING.reach_m
        self._steps_apart[row] = self._steps_apart[row] + 1 if far else 0
        if self._steps_apart[row] >= HANDLE_SPRING.lost_steps:
            self._lose(row)
        elif self._handle_in_ee_m[row].any():
            self._handle_in_ee_m[row] = HANDLE_SPRING.drawn_in(self._handle_in_ee_m[row])
            self._retie_handle(row)

    def _handle_gap_m(self, row: int, index: int) -> float:
        """Returns the distance of a handle to the hand."""
        return float(np.linalg.norm(self._place_in_ee_m(row, index)))

    def _place_in_ee_m(self, row: int, index: int) -> NDArray[np.float32]:
        """Returns a handle's position (3,) in the end-effector's frame."""
        if not self.scene.gpu_sim_enabled:
            link, offset = self._cpu_handles[index]
            world_from_ee = sapien_object(self.ee_link).entity_pose * EE_FROM_LINK
            return np.asarray((world_from_ee.inv() * (link.entity_pose * offset)).p)
        gap = (self.handle_position_m(index) - self.ee_position_m())[row]
        axes = self.ee_link.pose[row].to_transformation_matrix()[0, :3, :3]
        return (gap @ axes).cpu().numpy()

    def _lose(self, row: int) -> None:
        self._release_row(row)
        self.lost = _with(self.lost, row, True)
        self._any_lost = True

    def _release_row(self, row: int) -> None:
        if int(self.held[row]) != NOTHING:
            index = int(self.held[row])
            self._untie(row)
            self._leaving.append((row, index, _largest_side_m(self.objects[index])))
        elif int(self.held_handle[row]) != NOTHING:
            self._untie(row)
        self.held = _with(self.held, row, NOTHING)
        self.held_handle = _with(self.held_handle, row, NOTHING)
        self._busy.discard(row)

    def _drift_m(self, row: int) -> float:
        if not self.scene.gpu_sim_enabled:
            body = self._cpu_bodies[int(self.held[row])][0]
            held = sapien_object(self.ee_link).entity_pose * self._cpu_held
            gap: Any = np.subtract(held.p, body.entity_pose.p)
            return math.sqrt(float(gap @ gap))
        expected = self.ee_link.pose[row] * self._ee_from_object[row]
        return float(torch.linalg.norm(expected.p - self.objects[int(self.held[row])].pose[row].p))

    def _restore_collisions(self) -> None:
        ee = self.ee_position_m()
        still = []
        for row, index, side_m in self._leaving:
            if int(self.held[row]) == index:
                continue
            if float(torch.linalg.norm(self.object_com_m(index)[row] - ee[row])) < side_m:
                still.append((row, index, side_m))
            else:
                self._set_collision(row, index, MOVING)
        self._leaving = still

    def _set_collision(self, row: int, index: int, groups: Groups) -> None:
        # Contact filters can be changed at runtime on the CPU only.
        if not self.scene.gpu_sim_enabled:
            set_groups(self.objects[index]._bodies[row], groups)

    def _tie_object(self, row: int, index: int) -> None:
        raise NotImplementedError

    def _tie_handle(self, row: int, index: int) -> None:
        raise NotImplementedError

    def _retie_handle(self, row: int) -> None:
        """Hook after the held handle's position in the hand has changed."""

    def _untie(self, row: int) -> None:
        raise NotImplementedError


def _with(values: Tensor, row: int, value: int | bool) -> Tensor:
    """Returns a modified copy, as snapshots keep references."""
    changed = values.clone()
    changed[row] = value
    return changed


def _nearest(point: Tensor, candidates: Tensor) -> tuple[Tensor, Tensor]:
    """Returns index and distance (R,) of the candidate (R, K, 3) nearest to `point` (R, 3)."""
    if candidates.shape[1] == 0:
        none = torch.full((len(point),), NOTHING, dtype=torch.long, device=point.device)
        return none, torch.full((len(point),), float("inf"), device=point.device)
    best = torch.linalg.norm(candidates - point[:, None], dim=2).min(dim=1)
    return best.indices, best.values


def _largest_side_m(actor: Actor) -> float:
    low, high = rigid_body(actor).compute_global_aabb_tight()
    return float(np.max(np.asarray(high) - np.asarray(low)))
