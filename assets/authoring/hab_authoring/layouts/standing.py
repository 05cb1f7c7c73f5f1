"""Space for the robot in a layout: free floor, reachable receptacles, free spawn regions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hab_tasks.articulations import DRAWER, FRIDGE, FRIDGES, HANDLE_MARKERS, Rectangle
from hab_tasks.constants import BASE_RADIUS_M
from hab_tasks.geometry import to_matrix
from hab_tasks.privileged import Array
from hab_tasks.world.navigation import FARTHEST_M, NEAREST_M
from hab_tasks.world.scenes.floor import CELL_M, FreeFloor, floor_between
from hab_tasks.world.scenes.layout_geometry import STAGE, Layout
from hab_tasks.world.scenes.spec import Receptacle

ROOM_DOORS = ("door1", "door2", "door3", "doubledoor")
"""Templates of doors between rooms."""

FRIDGE_WORKING_REGION = Rectangle(x_m=(0.833, 1.25), y_m=(-0.6, 0.6))
DRAWER_WORKING_REGION = Rectangle(x_m=(1.10, 1.25), y_m=(-0.35, 0.35))
"""Where the base stands to work the door or the closed drawer: Habitat's spawn rectangles.

In the frame of `ArticulationKind.opening_region`; Habitat measures from a drawer's handle.
"""

PART_M2, WIDEST_M = 0.3, 1.5

_SPREAD = np.stack(np.meshgrid(*[np.linspace(-0.8, 0.8, 5)] * 2), axis=-1).reshape(-1, 2)
_SIGHT_END_M = 0.1
"""Lines of sight end this far from the point, as map cells of a wall may touch its shelf."""


class HandleRoom(NamedTuple):
    """Free floor before a handle.

    Attributes:
        working: Free share of the working region.
        spawn: Free share of the spawn regions: for a drawer the smaller one of that to open it,
            before the closed drawer, and that to close it, before the fully open one.
    """

    working: float
    spawn: float


class FloorPlan:
    """Floor maps of one layout and of its variations, in which pieces have moved.

    Attributes:
        bare: The floor between walls and closed doors, without furniture.
    """

    def __init__(self, layout: Layout) -> None:
        """Computes the outline of every shape once; motions on the floor do not change them."""
        loose = {item.name for item in layout.spec.objects if item.dynamic}
        fixed = [body for body in layout.placed.values() if body.piece not in loose]
        self._outlines: dict[str, list[Array]] = {}
        for body in fixed:
            self._outlines.setdefault(body.piece, []).extend(body.outlines_m)
        ground = [body.points_m[:2].T for body in fixed if body.piece == STAGE]
        self._corners = np.concatenate(ground or [body.points_m[:2].T for body in fixed])
        walls = self._outlines.get(STAGE, [])
        doors = [a.name for a in layout.spec.articulations if a.template in ROOM_DOORS]
        closed = [polygon for name in doors for polygon in self._outlines.get(name, [])]
        self._walls: NDArray[np.bool_] = floor_between(walls, self._corners).clearance_m == 0
        self.bare = floor_between([*walls, *closed], self._corners)

    def floor(self, motions: Mapping[str, Array] | None = None) -> FreeFloor:
        """Returns the free floor after pieces (by name) moved by (4, 4) motions."""
        outlines = []
        for piece, own in self._outlines.items():
            motion = (motions or {}).get(piece)
            if motion is None:
                outlines.extend(own)
            else:
                outlines.extend(o @ motion[:2, :2].T + motion[:2, 3] for o in own)
        return floor_between(outlines, self._corners)

    def cut_off(self, floor: FreeFloor) -> list[NDArray[np.bool_]]:
        """Returns the (X, Y) maps of free areas that furniture cuts off.

        Areas that only walls and closed doors separate do not count.
        """
        labelled: Any = ndimage.label((floor.clearance_m >= BASE_RADIUS_M) & ~floor.room)
        labels, count = labelled
        return [self.bare.room & (labels == number) for number in range(1, count + 1)]

    def reaches(self, floor: FreeFloor, points_m: Array) -> bool:
        """Whether some point (K, 2) is within reach, and not behind a wall, of the free floor."""
        low = np.floor((points_m.min(axis=0) - FARTHEST_M - floor.origin_m) / CELL_M).astype(int)
        high = np.ceil((points_m.max(axis=0) + FARTHEST_M - floor.origin_m) / CELL_M).astype(int)
        low = np.maximum(low, 0)
        window = floor.room[low[0] : high[0] + 1, low[1] : high[1] + 1]
        bases = floor.origin_m + CELL_M * (np.argwhere(window) + low)
        if not len(bases):
            return False
        distance = np.linalg.norm(points_m[:, None] - bases, axis=2)
        distance[(distance < NEAREST_M) | (distance > FARTHEST_M)] = np.inf
        nearest = distance.argmin(axis=1)
        found = np.isfinite(distance[np.arange(len(points_m)), nearest])
        if self._sees(floor, bases[nearest[found]], points_m[found]):
            return True
        pairs = np.argwhere(np.isfinite(distance))
        return self._sees(floor, bases[pairs[:, 1]], points_m[pairs[:, 0]])

    def _sees(self, floor: FreeFloor, bases_m: Array, points_m: Array) -> bool:
        """Whether any base (K, 2) sees its point (K, 2) past the walls."""
        if not len(bases_m):
            return False
        gap = points_m - bases_m
        length = np.linalg.norm(gap, axis=1, keepdims=True)
        end = bases_m + gap * (1.0 - np.minimum(1.0, _SIGHT_END_M / length))
        share = np.linspace(0.0, 1.0, 1 + int(FARTHEST_M / CELL_M))
        line = bases_m[:, None] + (end - bases_m)[:, None] * share[:, None]
        blocked = lookup(self._walls, floor, line.reshape(-1, 2)).reshape(line.shape[:2])
        return bool((~blocked).all(axis=1).any())


def narrowest_aisle_m(floor: FreeFloor) -> float:
    """Returns the smallest diameter of a round base that cannot reach all parts of the room.

    Parts smaller than `PART_M2` are ignored; `WIDEST_M` if a base of that diameter reaches all.
    """
    for width in np.arange(2 * BASE_RADIUS_M, WIDEST_M, CELL_M / 2):
        labelled: Any = ndimage.label(floor.room & (floor.clearance_m >= width / 2))
        sizes = np.bincount(labelled[0].ravel())[1:]
        if (CELL_M**2 * sizes > PART_M2).sum() > 1:
            return float(width)
    return WIDEST_M


def lookup(cells: NDArray[np.bool_], floor: FreeFloor, points_m: Array) -> NDArray[np.bool_]:
    """Returns the values of a map (X, Y) of `floor` at points (K, 2); False outside of it."""
    index = np.round((points_m - floor.origin_m) / CELL_M).astype(int)
    inside = ((index >= 0) & (index < cells.shape)).all(axis=1)
    index[~inside] = 0
    return cells[index[:, 0], index[:, 1]] & inside


def receptacle_points(layout: Layout, receptacle: Receptacle) -> Array:
    """Returns a grid of points (25, 2) on a receptacle, with its furniture closed."""
    level = [axis for axis in range(3) if abs(receptacle.up[axis]) < 0.5]
    local = np.zeros((25, 3))
    local[:, level] = _SPREAD
    local *= receptacle.half_size_m
    world_from_box = layout.placed[receptacle.body].world_from_body @ to_matrix(
        receptacle.body_from_box
    )
    return (local @ world_from_box[:3, :3].T + world_from_box[:3, 3])[:, :2]


def reachable(layout: Layout, plan: FloorPlan, floor: FreeFloor) -> dict[str, bool]:
    """Returns every receptacle (``body receptacle``) -> whether the robot can stand near it."""
    return {
        f"{r.body} {r.name}": plan.reaches(floor, receptacle_points(layout, r))
        for r in layout.spec.receptacles
    }


def handle_room(layout: Layout, floor: FreeFloor) -> dict[str, HandleRoom]:
    """Returns the free floor before the fridge and before every drawer with a handle."""
    found = {}
    for item in layout.spec.articulations:
        for marker in HANDLE_MARKERS:
            if marker.template != item.template:
                continue
            link = f"{item.name}/{marker.link}"
            closed = opened = layout.roots[item.name]
            kind, working = FRIDGE, FRIDGE_WORKING_REGION
            if item.template not in FRIDGES:
                closed = opened = layout.placed[link].world_from_body
                for joint in layout.joints:
                    if any(member.name == link for member in joint.members):
                        opened = joint.motion(joint.upper) @ closed
                kind, working = DRAWER, DRAWER_WORKING_REGION
            found[link] = HandleRoom(
                working=_free_share(closed, working, floor),
                spawn=min(
                    _free_share(closed, kind.opening_region, floor),
                    _free_share(opened, kind.closing_region, floor),
                ),
            )
    return found


def _free_share(world_from_origin: Array, region: Rectangle, floor: FreeFloor) -> float:
    """Returns the free share of a rectangle in a frame of furniture, given its (4, 4) pose."""
    axes = (np.arange(low, high + 1e-9, CELL_M) for low, high in (region.x_m, region.y_m))
    x, y = (grid.ravel() for grid in np.meshgrid(*axes))
    ahead = world_from_origin[:2, 0] / np.linalg.norm(world_from_origin[:2, 0])
    left = np.array([-ahead[1], ahead[0]])
    points_m = world_from_origin[:2, 3] + np.outer(x, ahead) + np.outer(y, left)
    return float(lookup(floor.room, floor, points_m).mean())
