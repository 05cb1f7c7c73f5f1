"""Which receptacles the skills and tasks use, how they stand in a layout, and points on them.

A receptacle is used only where it can be: level, with free room above its surface, within the arm's
height and with free floor near it. A closed one (fridge, drawers) names the joint that opens it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hab_tasks.episodes.schema import ReceptacleRef
from hab_tasks.episodes.workbench import Workbench
from hab_tasks.geometry import Array, to_matrix
from hab_tasks.robots.fetch_spec import EE_UPPER_M
from hab_tasks.scenes.spec import Receptacle

_AABB = "receptacle_aabb_"
SOFA = f"{_AABB}Sofa_frl_apartment_sofa"
FRIDGE = f"{_AABB}middle_topfrl_apartment_refrigerator"
COUNTER_LEFT = f"{_AABB}counter_left_kitchen_counter"
COUNTER_RIGHT = f"{_AABB}counter_right_kitchen_counter"
SINK = f"{_AABB}sink_kitchen_counter"
TABLE_LIGHT = f"{_AABB}Tbl1_Top1_frl_apartment_table_01"
TABLE_DARK = f"{_AABB}Tbl2_Top1_frl_apartment_table_02"
CHAIR = f"{_AABB}Chr1_Top1_frl_apartment_chair_01"
TV_STAND = f"{_AABB}TvStnd1_Top1_frl_apartment_tvstand"
DRAWER = f"{_AABB}drawer_right_top_frl_apartment_kitchen_counter"
CABINET = tuple(f"{_AABB}WC1_Top{i}frl_apartment_wall_cabinet_01" for i in range(1, 7))
SHELVES = tuple(f"{_AABB}WC2_Top{i}_frl_apartment_wall_cabinet_02" for i in range(1, 7))

COUNTER = (COUNTER_LEFT, COUNTER_RIGHT)
PICK_RECEPTACLES = (SOFA, FRIDGE, *COUNTER, TABLE_LIGHT, TABLE_DARK)
"""Sofa, fridge, counter left and right, light and dark wood table (S H.2)."""

PLACE_RECEPTACLES = (*PICK_RECEPTACLES, SINK)
"""Those of Pick, and the sink (S H.2)."""

SEEN_RECEPTACLES = (*COUNTER, SINK, TABLE_LIGHT, *CABINET, FRIDGE, TV_STAND, SOFA)
"""Seen when training for generalisation (S E.1)."""

UNSEEN_RECEPTACLES = (TABLE_DARK, *SHELVES, CHAIR)
"""Kept for evaluating generalisation (S E.1)."""

OPEN_RECEPTACLES = (CHAIR, TABLE_LIGHT, TABLE_DARK, TV_STAND, SINK, *COUNTER, SOFA)
"""Where the tasks put objects without opening anything (Habitat's set of eight)."""

MOST_OBJECTS = {CHAIR: 2, SINK: 2}
"""Receptacles that take no more objects than this (Habitat's generator)."""

FRIDGE_JOINT = "top_door_hinge"
FRIDGE_OPEN_RAD = 2.3
"""A fridge that is picked from stands open at its door's limit."""

UP_ALIGNMENT = math.cos(math.radians(10.0))
LEAST_ROOM_M = 0.1
"""A surface with less free height above every part of it is covered."""

ABOVE_BOARD_M = 0.02
"""Free height is measured from this far above a receptacle's lower face."""

FLOOR_REACH_M = 1.1
"""Farther from free floor than this, a surface cannot be reached."""

_TRIES = 30
_DOOR_STEPS = 24


@dataclass(frozen=True, kw_only=True, eq=False)
class Spot:
    """A receptacle in the world.

    Attributes:
        center_m: (3,) centre of its supporting face.
        axes: (3, 2) its two level directions in the world, as columns.
        half_m: (2,) half extents along them.
        height_m: Free height of the box above the face.
        joints: Furniture joints that must be open to use it.
    """

    receptacle: Receptacle
    center_m: Array
    axes: Array
    half_m: Array
    height_m: float
    joints: dict[str, dict[str, float]]

    @property
    def ref(self) -> ReceptacleRef:
        """Name and carrying body."""
        return self.receptacle.name, self.receptacle.body

    def sample(
        self,
        rng: np.random.Generator,
        radius_m: float,
        taken: list[tuple[Array, float]],
        inner: float = 1.0,
    ) -> Array | None:
        """Returns a point (3,) on the surface with room for a disc; None when none was found.

        Args:
            rng: The episode's generator.
            radius_m: Radius of the disc.
            taken: Centres (3,) and radii [m] of what lies there already.
            inner: Share of the half extents that is used (Habitat: half of the fridge's shelf).
        """
        room = inner * self.half_m - radius_m
        if (room < 0).any():
            room = np.maximum(room, 0.0)
            if (self.half_m < 0.6 * radius_m).any():
                return None
        for _ in range(_TRIES):
            point = self.center_m + self.axes @ (room * rng.uniform(-1.0, 1.0, 2))
            if all(np.linalg.norm(point - q) > 0.9 * (radius_m + r) for q, r in taken):
                return point
        return None


def find_spots(bench: Workbench, names: tuple[str, ...]) -> list[Spot]:
    """Returns those of `names` that can be used in the workbench's layout, in a fixed order.

    Closed ones are opened for it, and stay open: what moves with a drawer stands where the drawer
    is when its joints are where the spot says.
    """
    receptacles = receptacles_named(bench, names)
    opened = [_open(bench, receptacle) for receptacle in receptacles]
    found = [
        spot_of(bench, receptacle, joints)
        for receptacle, joints in zip(receptacles, opened, strict=True)
    ]
    return [spot for spot in found if unusable(bench, spot) is None]


def receptacles_named(bench: Workbench, names: tuple[str, ...]) -> list[Receptacle]:
    """Returns the layout's receptacles of these names, in a fixed order."""
    ordered = sorted(bench.spec.receptacles, key=lambda r: (r.name, r.body))
    return [receptacle for receptacle in ordered if receptacle.name in names]


def spot_of(bench: Workbench, receptacle: Receptacle, joints: dict[str, dict[str, float]]) -> Spot:
    """Returns a receptacle as it stands now; `joints` must be open to use it."""
    world_from_box = bench.world_from(receptacle.body) @ to_matrix(receptacle.body_from_box)
    up, half = np.array(receptacle.up), np.array(receptacle.half_size_m)
    bottom = world_from_box @ np.append(-up * (np.abs(up) @ half), 1.0)
    level = [i for i in range(3) if abs(up[i]) < 0.5]
    return Spot(
        receptacle=receptacle,
        center_m=bottom[:3],
        axes=world_from_box[:3, level],
        half_m=half[level],
        height_m=2 * float(np.abs(up) @ half),
        joints=joints,
    )


def unusable(bench: Workbench, spot: Spot) -> str | None:
    """Returns why a receptacle cannot be used, None when it can."""
    up = bench.world_from(spot.receptacle.body) @ to_matrix(spot.receptacle.body_from_box)
    if (up[:3, :3] @ np.array(spot.receptacle.up))[2] < UP_ALIGNMENT:
        return "not level"
    if spot.center_m[2] > EE_UPPER_M[2]:
        return "higher than the arm reaches"
    if bench.free_height_m(_corners(spot)) < min(LEAST_ROOM_M, spot.height_m) - ABOVE_BOARD_M:
        return "covered"
    nearest = bench.floor().cells_by_distance(spot.center_m, 0.0, 0.0)
    if not len(nearest):
        return "no free floor in the layout"
    offsets = np.abs((nearest[0] - spot.center_m[:2]) @ spot.axes[:2])
    if np.linalg.norm(np.maximum(offsets - spot.half_m, 0.0)) > FLOOR_REACH_M:
        return "too far from free floor"
    return None


def opening_joints(bench: Workbench, receptacle: Receptacle) -> dict[str, dict[str, float]]:
    """Returns furniture -> joint -> position that opens what a receptacle is in; empty if open."""
    furniture, _, link = receptacle.body.partition("/")
    if receptacle.name == FRIDGE:
        return {furniture: {FRIDGE_JOINT: widest(bench, furniture, FRIDGE_JOINT)}}
    joint = bench.joint_of(furniture, link) if link else None
    if joint is None:
        return {}
    return {furniture: {joint: bench.joint_limits(furniture, joint)[1]}}


def _open(bench: Workbench, receptacle: Receptacle) -> dict[str, dict[str, float]]:
    joints = opening_joints(bench, receptacle)
    for furniture, positions in joints.items():
        for joint, value in positions.items():
            bench.set_joint(furniture, joint, value)
    return joints


def widest(bench: Workbench, furniture: str, joint: str) -> float:
    """Returns the widest angle [rad] at which a door meets nothing, `FRIDGE_OPEN_RAD` at most.

    The door is closed again.
    """
    low, high = bench.joint_limits(furniture, joint)
    link = f"{furniture}/{bench.link_of(furniture, joint)}"
    wanted = float(np.clip(FRIDGE_OPEN_RAD, low, high))
    free = low
    for value in np.linspace(wanted, low, _DOOR_STEPS):
        bench.set_joint(furniture, joint, float(value))
        if not bench.touching(link):
            free = float(value)
            break
    bench.set_joint(furniture, joint, 0.0)
    return free


def _corners(spot: Spot) -> Array:
    """Returns nine points (9, 3) spread just above the surface, which may lie in its boards."""
    grid = np.array([(a, b) for a in (-0.7, 0.0, 0.7) for b in (-0.7, 0.0, 0.7)])
    above = np.array([0.0, 0.0, ABOVE_BOARD_M])
    return spot.center_m + above + (grid * spot.half_m) @ spot.axes.T
