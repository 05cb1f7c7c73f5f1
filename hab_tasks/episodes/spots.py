"""The receptacles that Pick uses (S H.2) as they stand in a layout, and points on them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hab_tasks.episodes.workbench import Workbench
from hab_tasks.geometry import Array, to_matrix
from hab_tasks.scenes.spec import Receptacle

PICK_RECEPTACLES = (
    "receptacle_aabb_Sofa_frl_apartment_sofa",
    "receptacle_aabb_middle_topfrl_apartment_refrigerator",
    "receptacle_aabb_counter_left_kitchen_counter",
    "receptacle_aabb_counter_right_kitchen_counter",
    "receptacle_aabb_Tbl1_Top1_frl_apartment_table_01",
    "receptacle_aabb_Tbl2_Top1_frl_apartment_table_02",
)
"""Sofa, fridge, counter left and right, light and dark table (S H.2)."""

FRIDGE_DOOR = "top_door_hinge"
FRIDGE_OPEN_RAD = 2.3
"""A fridge that is picked from stands open at its door's limit."""

UP_ALIGNMENT = math.cos(math.radians(10.0))
_TRIES = 30


@dataclass(frozen=True, kw_only=True, eq=False)
class Spot:
    """A receptacle in the world.

    Attributes:
        center_m: (3,) centre of its supporting face.
        axes: (3, 2) its two level directions in the world, as columns.
        half_m: (2,) half extents along them.
        joints: Furniture joints that must be open to use it.
    """

    receptacle: Receptacle
    center_m: Array
    axes: Array
    half_m: Array
    joints: dict[str, dict[str, float]]

    def sample(
        self, rng: np.random.Generator, radius_m: float, taken: list[tuple[Array, float]]
    ) -> Array | None:
        """Returns a point (3,) on the surface with room for a disc; None when none was found."""
        room = self.half_m - radius_m
        if (room < 0).any():
            room = np.maximum(room, 0.0)
            if (self.half_m < 0.6 * radius_m).any():
                return None
        for _ in range(_TRIES):
            point = self.center_m + self.axes @ (room * rng.uniform(-1.0, 1.0, 2))
            if all(np.linalg.norm(point - q) > 0.9 * (radius_m + r) for q, r in taken):
                return point
        return None


def find_spots(bench: Workbench) -> list[Spot]:
    """Returns Pick's receptacles in the workbench's layout, level ones only, in a fixed order."""
    spots = []
    for receptacle in sorted(bench.spec.receptacles, key=lambda r: (r.name, r.body)):
        if receptacle.name not in PICK_RECEPTACLES:
            continue
        world_from_box = bench.world_from(receptacle.body) @ to_matrix(receptacle.body_from_box)
        up = np.array(receptacle.up)
        if (world_from_box[:3, :3] @ up)[2] < UP_ALIGNMENT:
            continue
        half = np.array(receptacle.half_size_m)
        bottom = world_from_box @ np.append(-up * (np.abs(up) @ half), 1.0)
        level = [i for i in range(3) if abs(up[i]) < 0.5]
        spots.append(
            Spot(
                receptacle=receptacle,
                center_m=bottom[:3],
                axes=world_from_box[:3, level],
                half_m=half[level],
                joints=_joints(bench, receptacle),
            )
        )
    return spots


def _joints(bench: Workbench, receptacle: Receptacle) -> dict[str, dict[str, float]]:
    furniture = receptacle.body.split("/")[0]
    if "refrigerator" not in receptacle.name:
        return {}
    low, high = bench.joint_limits(furniture, FRIDGE_DOOR)
    return {furniture: {FRIDGE_DOOR: float(np.clip(FRIDGE_OPEN_RAD, low, high))}}
