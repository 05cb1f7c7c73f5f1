"""Receptacles in a layout: poses, usability, and sampling of points on them.

A usable receptacle is level, with free space above its surface, within the arm's height, and near
free floor. A closed one (fridge, drawers) names the joint that opens it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.schema import ReceptacleRef
from hab_tasks.geometry import Array, to_matrix
from hab_tasks.receptacles import CHAIR, FRIDGE, SINK
from hab_tasks.world.scenes.spec import Receptacle

MOST_OBJECTS = {CHAIR: 2, SINK: 2}
"""Maximum number of objects per receptacle (Habitat's generator)."""

FRIDGE_JOINT = "top_door_hinge"
FRIDGE_OPEN_RAD = 2.3
"""Open position of a fridge used as a receptacle: the door's limit."""

UP_ALIGNMENT = math.cos(math.radians(10.0))
LEAST_ROOM_M = 0.1
"""Minimum free height; a surface with less everywhere is unusable."""

ABOVE_BOARD_M = 0.02
"""Offset above a receptacle's lower face from which free height is measured."""

FLOOR_REACH_M = 1.1
"""Maximum distance of a reachable surface to free floor."""

_TRIES = 30
_DOOR_STEPS = 24


@dataclass(frozen=True, kw_only=True, eq=False)
class Spot:
    """A receptacle in the world.

    Attributes:
        center_m: (3,) centre of its supporting face.
        axes: (3, 2) its two horizontal axes in the world, as columns.
        half_m: (2,) half extents along them.
        height_m: Free height of the box above the face.
        joints: Furniture joints that must be open for access.
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
        """Samples a point (3,) on the surface with room for a disc; None if none was found.

        The disc avoids those of `taken`: centres (3,) and radii [m]. `inner` is the usable share of
        the half extents (Habitat: half of the fridge's shelf).
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


def find_spots(sandbox: PlacementSandbox, names: tuple[str, ...]) -> list[Spot]:
    """Returns the usable receptacles among `names` in the sandbox's layout, in a fixed order.

    Closed ones are opened and stay open, so that a spot in a drawer has the pose for which its
    `joints` are valid.
    """
    receptacles = receptacles_named(sandbox, names)
    opened = [_open(sandbox, receptacle) for receptacle in receptacles]
    key = (sandbox.spec.scene_id, names, repr(opened), sandbox.state())

    def usable() -> tuple[list[Spot], bool]:
        found = [spot_of(sandbox, *both) for both in zip(receptacles, opened, strict=True)]
        spots = [spot for spot in found if unusable(sandbox, spot) is None]
        return spots, sandbox.floor_known()

    spots, floor_mapped = sandbox.memory.recall(key, usable)
    if floor_mapped:
        sandbox.floor()
    return list(spots)


def receptacles_named(sandbox: PlacementSandbox, names: tuple[str, ...]) -> list[Receptacle]:
    """Returns the layout's receptacles of these names, in a fixed order."""
    ordered = sorted(sandbox.spec.receptacles, key=lambda r: (r.name, r.body))
    return [receptacle for receptacle in ordered if receptacle.name in names]


def spot_of(
    sandbox: PlacementSandbox, receptacle: Receptacle, joints: dict[str, dict[str, float]]
) -> Spot:
    """Returns a receptacle at its current pose; `joints` must be open for access."""
    world_from_box = sandbox.world_from(receptacle.body) @ to_matrix(receptacle.body_from_box)
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


def unusable(sandbox: PlacementSandbox, spot: Spot) -> str | None:
    """Returns the reason why a receptacle is unusable, or None."""
    up = sandbox.world_from(spot.receptacle.body) @ to_matrix(spot.receptacle.body_from_box)
    if (up[:3, :3] @ np.array(spot.receptacle.up))[2] < UP_ALIGNMENT:
        return "not level"
    if spot.center_m[2] > sandbox.robot.ee_upper_m[2]:
        return "higher than the arm reaches"
    if sandbox.free_height_m(_corners(spot)) < min(LEAST_ROOM_M, spot.height_m) - ABOVE_BOARD_M:
        return "covered"
    nearest = sandbox.floor().nearest_cell(spot.center_m)
    if nearest is None:
        return "no free floor in the layout"
    offsets = np.abs((nearest - spot.center_m[:2]) @ spot.axes[:2])
    if np.linalg.norm(np.maximum(offsets - spot.half_m, 0.0)) > FLOOR_REACH_M:
        return "too far from free floor"
    return None


def opening_joints(
    sandbox: PlacementSandbox, receptacle: Receptacle
) -> dict[str, dict[str, float]]:
    """Returns furniture -> joint -> position that gives access to a receptacle; empty if open."""
    furniture, _, link = receptacle.body.partition("/")
    if receptacle.name == FRIDGE:
        return {furniture: {FRIDGE_JOINT: widest(sandbox, furniture, FRIDGE_JOINT)}}
    joint = sandbox.joint_of(furniture, link) if link else None
    if joint is None:
        return {}
    return {furniture: {joint: sandbox.joint_limits(furniture, joint)[1]}}


def _open(sandbox: PlacementSandbox, receptacle: Receptacle) -> dict[str, dict[str, float]]:
    joints = opening_joints(sandbox, receptacle)
    sandbox.open_joints(joints)
    return joints


def widest(sandbox: PlacementSandbox, furniture: str, joint: str) -> float:
    """Returns the largest collision-free angle [rad] of a door, `FRIDGE_OPEN_RAD` at most.

    The door is closed again.
    """
    low, high = sandbox.joint_limits(furniture, joint)
    link = f"{furniture}/{sandbox.link_of(furniture, joint)}"
    wanted = float(np.clip(FRIDGE_OPEN_RAD, low, high))
    free = low
    for value in np.linspace(wanted, low, _DOOR_STEPS):
        sandbox.set_joint(furniture, joint, float(value))
        if not sandbox.touching(link):
            free = float(value)
            break
    sandbox.set_joint(furniture, joint, 0.0)
    return free


def _corners(spot: Spot) -> Array:
    """Returns nine points (9, 3) just above the surface, some possibly inside its boards."""
    grid = np.array([(a, b) for a in (-0.7, 0.0, 0.7) for b in (-0.7, 0.0, 0.7)])
    above = np.array([0.0, 0.0, ABOVE_BOARD_M])
    return spot.center_m + above + (grid * spot.half_m) @ spot.axes.T
