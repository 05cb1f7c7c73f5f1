"""Observation entries: one table of name, shape and unit, and how each is read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor

from hab_tasks.constants import CAMERA_DEPTH_MAX_M, REST_POSITION_M
from hab_tasks.measures import Measures
from hab_tasks.snapshot import Snapshot


@dataclass(frozen=True, kw_only=True)
class Goals:
    """What the episode asks for, batched.

    Attributes:
        object_start_m: (N, 3) where the target's centre of mass was when the episode began.
    """

    object_start_m: Tensor


Reader = Callable[[Snapshot, Measures, Goals], Tensor]


@dataclass(frozen=True, kw_only=True)
class ObsEntry:
    """One entry of the state observation."""

    name: str
    shape: tuple[int, ...]
    unit: str
    meaning: str
    read: Reader


def in_ee_frame(s: Snapshot, point_m: Tensor) -> Tensor:
    """Maps a world point (N, 3) to the end-effector's frame (N, 3)."""
    return torch.matmul((point_m - s.ee_m).unsqueeze(1), s.ee_axes).squeeze(1)


def _rest_from_ee(s: Snapshot, m: Measures, g: Goals) -> Tensor:
    return _rest(m.ee_in_base_m.device) - m.ee_in_base_m


@lru_cache(maxsize=4)
def _rest(device: torch.device) -> Tensor:
    return torch.tensor(REST_POSITION_M, device=device)


ARM_QPOS = ObsEntry(
    name="arm_qpos",
    shape=(7,),
    unit="rad",
    meaning="arm joints, shoulder to wrist",
    read=lambda s, m, g: s.arm_qpos_rad,
)
EE_POSITION = ObsEntry(
    name="ee_position",
    shape=(3,),
    unit="m",
    meaning="end-effector in the base frame",
    read=lambda s, m, g: m.ee_in_base_m,
)
IS_HOLDING = ObsEntry(
    name="is_holding",
    shape=(1,),
    unit="0 or 1",
    meaning="whether anything is in the hand",
    read=lambda s, m, g: ((s.held >= 0) | (s.held_handle >= 0)).to(torch.float32)[:, None],
)
REST_FROM_EE = ObsEntry(
    name="rest_from_ee",
    shape=(3,),
    unit="m",
    meaning="from the end-effector to its resting position, base frame",
    read=_rest_from_ee,
)
OBJECT_START_IN_EE = ObsEntry(
    name="object_start_in_ee",
    shape=(3,),
    unit="m",
    meaning="the target's starting position in the end-effector's frame",
    read=lambda s, m, g: in_ee_frame(s, g.object_start_m),
)


def scale_depth(depth_mm: Tensor) -> Tensor:
    """Maps ManiSkill's depth (N, H, W, 1) int16 [mm] to float32 in [0, 1], 1 at 10 m or nothing."""
    depth = depth_mm.to(torch.float32) / (1000.0 * CAMERA_DEPTH_MAX_M)
    return torch.where(depth <= 0, torch.ones_like(depth), depth.clamp(max=1.0))
