"""Observation entries: one table of name, shape and unit, and how each is read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, get_args

import numpy as np
import torch
from torch import Tensor

from hab_tasks.agent import TargetFrame
from hab_tasks.arrays import Rows, cos, is_numpy, maximum, sin, stack
from hab_tasks.constants import CAMERA_DEPTH_MAX_M, REST_POSITION_M
from hab_tasks.errors import OptionError, UnknownNameError
from hab_tasks.goals import Goals
from hab_tasks.measures import Measures
from hab_tasks.snapshot import Snapshot

Reader = Callable[[Snapshot, Measures, Goals], Rows]


@dataclass(frozen=True, kw_only=True)
class ObsEntry:
    """One entry of the state observation.

    Attributes:
        name: Its key.
        shape: Shape of one row.
        unit: Its unit.
        meaning: One line for tables.
        read: (snapshot, measures, goals) -> (N, *shape) float32.
        proprioceptive: The robot feels it; the others tell what is to be done.
        in_ee: What takes its place with ``target_frame="ee"``: the same in the end-effector's
            frame; None where there is only this one.
    """

    name: str
    shape: tuple[int, ...]
    unit: str
    meaning: str
    read: Reader
    proprioceptive: bool = False
    in_ee: ObsEntry | None = None

    @property
    def group(self) -> Literal["agent", "extra"]:
        """The part of the observation that it is in."""
        return "agent" if self.proprioceptive else "extra"


def observed(
    entries: Sequence[ObsEntry],
    handle: ObsEntry | None,
    target_frame: str = "base",
    handle_position: bool = False,
) -> tuple[ObsEntry, ...]:
    """Returns the entries of an environment with its options.

    Args:
        entries: Those without options.
        handle: The entry that `handle_position` adds; None where no door or drawer is in question.
        target_frame: The option, ``base`` or ``ee``.
        handle_position: The option.

    Raises:
        UnknownNameError: There is no such frame.
        OptionError: The environment does not have the option.
    """
    chosen = tuple(entries)
    if target_frame not in get_args(TargetFrame):
        raise UnknownNameError("target_frame", target_frame, get_args(TargetFrame))
    if target_frame == "ee":
        if all(entry.in_ee is None for entry in chosen):
            raise OptionError("target_frame", target_frame, "'base' in a task")
        chosen = tuple(entry.in_ee or entry for entry in chosen)
    if not handle_position:
        return chosen
    if handle is None:
        valid = "False in an environment that is about no door or drawer"
        raise OptionError("handle_position", handle_position, valid)
    return (*chosen, handle)


def along_base_axes(s: Snapshot, point_m: Rows) -> Rows:
    """Returns the vector from the end-effector to a world point (N, 3) in base axes, (N, 3)."""
    return _from_ee(s, point_m, s.base_axes)


def in_ee_frame(s: Snapshot, point_m: Rows) -> Rows:
    """Maps a world point (N, 3) to the end-effector's frame (N, 3)."""
    return _from_ee(s, point_m, s.ee_axes)


def _from_ee(s: Snapshot, point_m: Rows, axes: Rows) -> Rows:
    """Returns the vector from the end-effector to a point (N, 3) along axes (N, 3, 3), (N, 3)."""
    return ((point_m - s.ee_m)[:, None] @ axes)[:, 0]


def in_base_frame(s: Snapshot, points_m: Rows) -> Rows:
    """Maps world points (N, P, 3) to the base's frame (N, P, 3); heights stay."""
    yaw = s.base[:, 2:]
    cosine, sine = cos(yaw), sin(yaw)
    x, y = points_m[:, :, 0] - s.base[:, :1], points_m[:, :, 1] - s.base[:, 1:2]
    return stack((cosine * x + sine * y, cosine * y - sine * x, points_m[:, :, 2]), axis=2)


def _rest_from_ee(s: Snapshot, m: Measures, g: Goals) -> Rows:
    rest = _REST if is_numpy(m.ee_in_base_m) else _rest(m.ee_in_base_m.device)
    return rest - m.ee_in_base_m


_REST = np.array(REST_POSITION_M, dtype=np.float32)


@lru_cache(maxsize=4)
def _rest(device: torch.device) -> Tensor:
    return torch.tensor(REST_POSITION_M, device=device)


def _ee_rotation(s: Snapshot, m: Measures, g: Goals) -> Rows:
    # Row vectors times the base's axes: each axis of the hand in the base frame.
    return (s.ee_axes.swapaxes(1, 2)[:, :2] @ s.base_axes).reshape(-1, 6)


def _is_holding(s: Snapshot, m: Measures, g: Goals) -> Rows:
    holding = maximum(s.held, s.held_handle)[:, None] >= 0
    return holding.astype(np.float32) if is_numpy(holding) else holding.float()


ARM_QPOS = ObsEntry(
    name="arm_qpos",
    shape=(7,),
    unit="rad",
    meaning="arm joints, shoulder to wrist",
    read=lambda s, m, g: s.arm_qpos_rad,
    proprioceptive=True,
)
EE_POSITION = ObsEntry(
    name="ee_position",
    shape=(3,),
    unit="m",
    meaning="end-effector in the base frame",
    read=lambda s, m, g: m.ee_in_base_m,
    proprioceptive=True,
)
EE_ROTATION = ObsEntry(
    name="ee_rotation",
    shape=(6,),
    unit="1",
    meaning="x axis of the end-effector's frame, then its y axis, in the base frame",
    read=_ee_rotation,
    proprioceptive=True,
)
IS_HOLDING = ObsEntry(
    name="is_holding",
    shape=(1,),
    unit="0 or 1",
    meaning="whether anything is in the hand",
    read=_is_holding,
    proprioceptive=True,
)
REST_FROM_EE = ObsEntry(
    name="rest_from_ee",
    shape=(3,),
    unit="m",
    meaning="from the end-effector to its resting position, base frame",
    read=_rest_from_ee,
    proprioceptive=True,
)
OBJECT_START = ObsEntry(
    name="object_start_from_ee",
    shape=(3,),
    unit="m",
    meaning="from the end-effector to the target's starting position, base frame",
    read=lambda s, m, g: along_base_axes(s, g.starts_m[:, 0]),
    in_ee=ObsEntry(
        name="object_start_in_ee",
        shape=(3,),
        unit="m",
        meaning="the target's starting position in the end-effector's frame",
        read=lambda s, m, g: in_ee_frame(s, g.starts_m[:, 0]),
    ),
)
OBJECT_GOAL = ObsEntry(
    name="object_goal_from_ee",
    shape=(3,),
    unit="m",
    meaning="from the end-effector to the target's goal position, base frame",
    read=lambda s, m, g: along_base_axes(s, g.goals_m[:, 0]),
    in_ee=ObsEntry(
        name="object_goal_in_ee",
        shape=(3,),
        unit="m",
        meaning="the target's goal position in the end-effector's frame",
        read=lambda s, m, g: in_ee_frame(s, g.goals_m[:, 0]),
    ),
)
# Where an object is only to be taken, its goal is its start. The base turns about its own frame's
# origin, not about the hand.
POINT = ObsEntry(
    name="point_in_base",
    shape=(3,),
    unit="m",
    meaning="start or goal of the object in question, in the base frame",
    read=lambda s, m, g: in_base_frame(s, g.goals_m[:, :1])[:, 0],
    in_ee=ObsEntry(
        name="point_in_ee",
        shape=(3,),
        unit="m",
        meaning="start or goal of the object in question, in the end-effector's frame",
        read=lambda s, m, g: in_ee_frame(s, g.goals_m[:, 0]),
    ),
)
HANDLE = ObsEntry(
    name="handle_from_ee",
    shape=(3,),
    unit="m",
    meaning="from the end-effector to the handle where it is now, base frame",
    read=lambda s, m, g: along_base_axes(s, s.handles_m[:, 0]),
)
PROPRIOCEPTION = (ARM_QPOS, EE_POSITION, EE_ROTATION, IS_HOLDING, REST_FROM_EE)


def targets_in_base(objects: int) -> ObsEntry:
    """Returns the entry that specifies a task: starts and goals of its objects (S H.3)."""

    def read(s: Snapshot, m: Measures, g: Goals) -> Rows:
        count, objects = g.starts_m.shape[:2]
        pairs = stack((g.starts_m, g.goals_m), axis=2).reshape(count, 2 * objects, 3)
        return in_base_frame(s, pairs).reshape(count, 6 * objects)

    return ObsEntry(
        name="targets_in_base",
        shape=(6 * objects,),
        unit="m",
        meaning="start and goal of each object in turn, in the base frame",
        read=read,
    )


def handles_in_base(fronts: int) -> ObsEntry:
    """Returns the entry that tells a task's handles, where they are now."""
    return ObsEntry(
        name="handles_in_base",
        shape=(3 * fronts,),
        unit="m",
        meaning="handle of each door and drawer in turn where it is now, in the base frame",
        read=lambda s, m, g: in_base_frame(s, s.handles_m).reshape(-1, 3 * fronts),
    )


def scale_depth(depth_mm: Tensor) -> Tensor:
    """Maps ManiSkill's depth (N, H, W, 1) int16 [mm] to float32 in [0, 1], 1 at 10 m or nothing."""
    depth = depth_mm.to(torch.float32) / (1000.0 * CAMERA_DEPTH_MAX_M)
    return torch.where(depth <= 0, torch.ones_like(depth), depth.clamp(max=1.0))
