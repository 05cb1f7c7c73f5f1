"""Entries of the state observation: name, shape, unit and reader of each."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
import torch
from torch import Tensor

from hab_tasks.agent import TargetFrame, Targets
from hab_tasks.arrays import Floats
from hab_tasks.constants import CAMERA_DEPTH_MAX_M
from hab_tasks.engine.goals import Goals
from hab_tasks.engine.measures import Measures
from hab_tasks.engine.snapshot import Snapshot, world_to_base
from hab_tasks.errors import OptionError, UnknownNameError
from hab_tasks.robots.spec import RobotSpec

Reader = Callable[[Snapshot, Measures, Goals], Floats]


@dataclass(frozen=True, kw_only=True)
class ObsEntry:
    """One entry of the state observation.

    Attributes:
        name: Its key.
        shape: Shape of one row.
        unit: Its unit.
        meaning: One line for tables.
        read: (snapshot, measures, goals) -> (N, *shape) float32.
        proprioceptive: Whether it is proprioception; the others specify the goal.
        in_ee: Its replacement with ``target_frame="ee"``, in the end-effector's frame; None if the
            entry has no such variant.
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
        """Group of the observation."""
        return "agent" if self.proprioceptive else "extra"


def of_robot(entries: Iterable[ObsEntry], robot: RobotSpec) -> tuple[ObsEntry, ...]:
    """Returns entries with the shapes that follow from a robot, and those of its fingers."""
    found: list[ObsEntry] = []
    for entry in entries:
        if entry.name != ARM_QPOS.name:
            found.append(entry)
            continue
        found.append(replace(entry, shape=(len(robot.arm_joints),)))
        if robot.fingers is not None:
            found.append(FINGERS)
    return tuple(found)


def observed(
    entries: Sequence[ObsEntry],
    handle: ObsEntry | None,
    robot: RobotSpec,
    target_frame: str = "base",
    handle_position: bool = False,
    targets: str = "positions",
) -> tuple[ObsEntry, ...]:
    """Returns the entries of an environment with this robot under its options.

    `handle` is the entry that `handle_position` adds, None without a door or drawer.

    Raises:
        UnknownNameError: Unknown frame.
        OptionError: The environment does not support the option.
    """
    chosen = of_robot(entries, robot)
    if target_frame not in get_args(TargetFrame):
        raise UnknownNameError("target_frame", target_frame, get_args(TargetFrame))
    if targets not in get_args(Targets):
        raise UnknownNameError("targets", targets, get_args(Targets))
    if targets == "language":
        if target_frame != "base" or handle_position:
            valid = "'positions' with target_frame='ee' or handle_position=True"
            raise OptionError.of_value("targets", targets, valid)
        return tuple(entry for entry in chosen if entry.proprioceptive)
    if target_frame == "ee":
        if all(entry.in_ee is None for entry in chosen):
            raise OptionError.of_value("target_frame", target_frame, "'base' in a task")
        chosen = tuple(entry.in_ee or entry for entry in chosen)
    if not handle_position:
        return chosen
    if handle is None:
        valid = "False in an environment without a door or drawer"
        raise OptionError.of_value("handle_position", handle_position, valid)
    return (*chosen, handle)


def observation_doc(entries: Sequence[ObsEntry], cameras: Sequence[str]) -> str:
    """Returns the observation of an environment in words and a table, for its docstring."""
    rows = [
        ("entry", "group", "shape", "unit", "meaning"),
        *((e.name, e.group, "x".join(map(str, e.shape)), e.unit, e.meaning) for e in entries),
        (", ".join(cameras), "sensor_data", "128²", "0..1", "depth, 1 at 10 m; uint8 with ``rgb``"),
    ]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    rule = "  ".join("=" * width for width in widths)
    head, *lines = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
    about = "(``state_dict``: ``agent`` and ``extra``; ``state`` is their concatenation)"
    return "\n".join([f"**Observation** {about}:\n", rule, head, rule, *lines, rule])


def _from_ee(s: Snapshot, point_m: Floats, axes: Floats) -> Floats:
    """Returns the vector from the end-effector to a point (N, 3) along axes (N, 3, 3), (N, 3)."""
    return ((point_m - s.ee_m)[:, None] @ axes)[:, 0]


def _ee_rotation(s: Snapshot, m: Measures, g: Goals) -> Floats:
    # Row vectors times the base's axes: the axes of the hand in the base frame.
    return (s.ee_axes.swapaxes(1, 2)[:, :2] @ s.base_axes).reshape(-1, 6)


def _is_holding(s: Snapshot, m: Measures, g: Goals) -> Floats:
    return (np.maximum(s.held, s.held_handle)[:, None] >= 0).astype(np.float32)


ARM_QPOS = ObsEntry(
    name="arm_qpos",
    shape=(),  # by robot: `of_robot`
    unit="rad",
    meaning="arm joints, shoulder to wrist",
    read=lambda s, m, g: s.arm_qpos_rad,
    proprioceptive=True,
)
FINGERS = ObsEntry(
    name="fingers",
    shape=(2,),
    unit="m",
    meaning="joints of the fingers, 0 is closed",
    read=lambda s, m, g: s.fingers_m,
    proprioceptive=True,
)
"""With a grasp by friction."""

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
    meaning="x, then y axis of the end-effector, base frame",
    read=_ee_rotation,
    proprioceptive=True,
)
IS_HOLDING = ObsEntry(
    name="is_holding",
    shape=(1,),
    unit="0 or 1",
    meaning="whether the gripper holds anything",
    read=_is_holding,
    proprioceptive=True,
)
REST_FROM_EE = ObsEntry(
    name="rest_from_ee",
    shape=(3,),
    unit="m",
    meaning="end-effector to its resting position, base frame",
    read=lambda s, m, g: g.rest_m - m.ee_in_base_m,
    proprioceptive=True,
)
OBJECT_START = ObsEntry(
    name="object_start_from_ee",
    shape=(3,),
    unit="m",
    meaning="end-effector to the target's starting position, base frame",
    read=lambda s, m, g: _from_ee(s, g.starts_m[:, 0], s.base_axes),
    in_ee=ObsEntry(
        name="object_start_in_ee",
        shape=(3,),
        unit="m",
        meaning="starting position in the end-effector frame",
        read=lambda s, m, g: _from_ee(s, g.starts_m[:, 0], s.ee_axes),
    ),
)
OBJECT_GOAL = ObsEntry(
    name="object_goal_from_ee",
    shape=(3,),
    unit="m",
    meaning="end-effector to the target's goal position, base frame",
    read=lambda s, m, g: _from_ee(s, g.goals_m[:, 0], s.base_axes),
    in_ee=ObsEntry(
        name="object_goal_in_ee",
        shape=(3,),
        unit="m",
        meaning="goal position in the end-effector frame",
        read=lambda s, m, g: _from_ee(s, g.goals_m[:, 0], s.ee_axes),
    ),
)
# The goal of an object without a goal position is its start. The base rotates about the origin of
# its own frame, not about the hand.
POINT = ObsEntry(
    name="point_in_base",
    shape=(3,),
    unit="m",
    meaning="start or goal of the object, base frame",
    read=lambda s, m, g: world_to_base(s.base, g.goals_m[:, :1])[:, 0],
    in_ee=ObsEntry(
        name="point_in_ee",
        shape=(3,),
        unit="m",
        meaning="start or goal in the end-effector frame",
        read=lambda s, m, g: _from_ee(s, g.goals_m[:, 0], s.ee_axes),
    ),
)
HANDLE = ObsEntry(
    name="handle_from_ee",
    shape=(3,),
    unit="m",
    meaning="end-effector to the current handle position, base frame",
    read=lambda s, m, g: _from_ee(s, s.handles_m[:, 0], s.base_axes),
)
PROPRIOCEPTION = (ARM_QPOS, EE_POSITION, EE_ROTATION, IS_HOLDING, REST_FROM_EE)


def targets_in_base(objects: int) -> ObsEntry:
    """Returns the goal entry of a task: starts and goals of its objects (S H.3)."""

    def read(s: Snapshot, m: Measures, g: Goals) -> Floats:
        count, objects = g.starts_m.shape[:2]
        pairs = np.stack((g.starts_m, g.goals_m), axis=2).reshape(count, 2 * objects, 3)
        return world_to_base(s.base, pairs).reshape(count, 6 * objects)

    return ObsEntry(
        name="targets_in_base",
        shape=(6 * objects,),
        unit="m",
        meaning="start and goal of each object, base frame",
        read=read,
    )


def handles_in_base(articulations: int) -> ObsEntry:
    """Returns the entry of a task's current handle positions."""
    return ObsEntry(
        name="handles_in_base",
        shape=(3 * articulations,),
        unit="m",
        meaning="current handle of each door and drawer, base frame",
        read=lambda s, m, g: world_to_base(s.base, s.handles_m).reshape(-1, 3 * articulations),
    )


def scale_depth(depth_mm: Tensor) -> Tensor:
    """Maps ManiSkill's depth (N, H, W, 1) int16 [mm] to float32 in [0, 1].

    1 is 10 m and beyond, or no return.
    """
    depth = depth_mm.to(torch.float32) / (1000.0 * CAMERA_DEPTH_MAX_M)
    # ManiSkill's 0 is no return: beyond the range, and not at the lens.
    return torch.where(depth <= 0, torch.ones_like(depth), depth.clamp(max=1.0))
