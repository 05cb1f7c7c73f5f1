"""Navigation: maps of the free floor, geodesic distances, paths, base poses for reaching (S H.2).

Space is free where the disc that models the base fits between all collision shapes. Distances solve
the eikonal equation by the fast marching method (eikonalfm) over the free cells, so they are those
of smooth paths, not of steps on a grid.
"""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterable, Mapping
from functools import cached_property, lru_cache
from typing import Any

import eikonalfm
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hab_tasks.constants import BASE_RADIUS_M
from hab_tasks.errors import GenerationError
from hab_tasks.io.cache import recalled
from hab_tasks.privileged import Array, CollisionBody
from hab_tasks.world.scenes.floor import (
    CELL_M,
    FreeFloor,
    body_outline,
    floor_between,
    free_floor,
    touched,
)
from hab_tasks.world.scenes.layout_geometry import STAGE, Layout
from hab_tasks.world.scenes.spec import SceneSpec

SLOW, FAST = 1e-6, 1e6
"""Speed of the wavefront in occupied cells and in goal cells; 1 elsewhere."""

KEPT_FIELDS = 256
"""Size of the LRU cache of distance fields; one takes 150 kB and a few milliseconds."""

_NEAR_M = 2 * CELL_M
"""Distance to a goal up to which distances are straight lines."""

_LEAST_WEIGHT = 1e-3
"""Bilinear weight below which a cell beside the goal needs no wavefront of its own."""

_CORNERS = np.array([(0, 0), (0, 1), (1, 0), (1, 1)])
_fields: OrderedDict[Hashable, Array] = OrderedDict()


class NavigationMap:
    """Free cells of one layout for one base radius.

    Attributes:
        floor: Clearances, and the room: the largest connected area for the base.
        free: (X, Y) cells of the room, valid for the centre of the base.
        walls: (X, Y) cells with walls.
    """

    def __init__(self, floor: FreeFloor, walls: NDArray[np.bool_]) -> None:
        """Wraps a computed map.

        Raises:
            GenerationError: No cell is free.
        """
        if not floor.room.any():
            raise GenerationError("no free floor: the base fits nowhere in this layout.")
        self.floor, self.free, self.walls = floor, floor.room, walls

    @staticmethod
    def of_bodies(
        bodies: Iterable[CollisionBody],
        world_from_body: dict[str, Array],
    ) -> NavigationMap:
        """Maps a layout from all obstacles, at poses (4, 4) by body name."""
        bodies = list(bodies)
        floor = free_floor(bodies, world_from_body)
        parts = [body_outline(b, world_from_body[b.name]) for b in bodies if b.group == "stage"]
        walls = [outline for part in parts for outline in part.outlines_m]
        return NavigationMap(floor, touched(walls, floor.origin_m - CELL_M / 2, floor.room.shape))

    @staticmethod
    def of_layout(
        layout: Layout,
        joints: Mapping[tuple[str, str], float] | None = None,
        radius_m: float = BASE_RADIUS_M,
    ) -> NavigationMap:
        """Maps a layout without a simulator; its loose objects are ignored.

        `joints` are open doors and drawers: (furniture, joint) -> position [m or rad].
        """
        loose = {item.name for item in layout.spec.objects if item.dynamic}
        bodies = [b for b in layout.opened(joints or {}).values() if b.piece not in loose]
        outlines = [outline for body in bodies for outline in body.outlines_m]
        floor = floor_between(outlines, _corners(layout), radius_m)
        return NavigationMap(floor, _walls(layout))

    @cached_property
    def key(self) -> str:
        """Short hash of the free cells and the map's origin."""
        origin = np.round(self.floor.origin_m, 6).tobytes()
        data = origin + repr(self.free.shape).encode() + np.packbits(self.free).tobytes()
        return hashlib.sha256(data).hexdigest()[:20]

    def positions(self, cells: NDArray[np.int64]) -> Array:
        """Returns the world positions (..., 2) of the centres of cells (..., 2)."""
        return self.floor.origin_m + CELL_M * cells

    def cells_of(self, points_m: Array) -> NDArray[np.int64]:
        """Returns the cells (..., 2) of points (..., 2); the nearest cell outside the map."""
        cells = np.round(self._grid(points_m)).astype(np.int64)
        return np.clip(cells, 0, np.array(self.free.shape) - 1)

    def is_free(self, points_m: Array) -> NDArray[np.bool_]:
        """Whether the base can be at points (..., 2)."""
        x, y = np.moveaxis(self.cells_of(points_m), -1, 0)
        grid = self._grid(points_m)
        inside = ((grid > -0.5) & (grid < np.array(self.free.shape) - 0.5)).all(axis=-1)
        return inside & self.free[x, y]

    def clearance_m(self, points_m: Array) -> Array:
        """Returns the distances (...) [m] of points (..., 2) from the nearest obstacle."""
        x, y = np.moveaxis(self.cells_of(points_m), -1, 0)
        return self.floor.clearance_m[x, y]

    def nearest_free(self, points_m: Array) -> Array:
        """Returns the free positions (..., 2) nearest to points (..., 2); free points unchanged."""
        points = np.asarray(points_m, dtype=float)[..., :2]
        x, y = np.moveaxis(self.cells_of(points), -1, 0)
        nearest = self.positions(np.moveaxis(self._nearest[:, x, y], 0, -1))
        return np.where(self.is_free(points)[..., None], points, nearest)

    def geodesic_field(self, goals_m: Array | NDArray[np.bool_]) -> Array:
        """Returns the geodesic distance [m] from every cell to the nearest goal.

        Args:
            goals_m: One point (2,), points (K, 2), or a map (X, Y) of goal cells. Goals that are
                not free are replaced by the nearest free position.

        Returns:
            (X, Y), inf in cells that are not free. Cached; do not modify.
        """
        goals: Any = self._free_goals(goals_m)
        if not len(goals):
            return np.full(self.free.shape, np.inf)
        key = f"{self.key} {hashlib.sha256(goals.tobytes()).hexdigest()}"

        def make() -> Array:
            of_points = goals.dtype != bool
            parts = map(self._from_point, goals) if of_points else self._from_cells(goals)
            field = np.minimum.reduce(list(parts))
            field.setflags(write=False)
            return field

        return recalled(_fields, key, make, KEPT_FIELDS)

    def everywhere(self, field: Array) -> Array:
        """Extends a field (X, Y) to occupied cells, by straight lines to the nearest free cell.

        A base in contact with an obstacle may be in a cell that is not free.
        """
        x, y = self._nearest
        cells = np.stack(np.meshgrid(*map(np.arange, field.shape), indexing="ij"))
        return field[x, y] + CELL_M * np.linalg.norm(cells - self._nearest, axis=0)

    def clear(self, start_m: Array, end_m: Array) -> bool:
        """Whether the straight line between two points (2,) is free."""
        count = 1 + int(np.ceil(np.linalg.norm(end_m - start_m) / (CELL_M / 4)))
        share = np.linspace(0.0, 1.0, 1 + count)[:, None]
        return bool(self.is_free(start_m + share * (end_m - start_m)).all())

    def _grid(self, points_m: Array) -> Array:
        """Returns points (..., 2) in units of cells."""
        return (np.asarray(points_m, dtype=float)[..., :2] - self.floor.origin_m) / CELL_M

    @cached_property
    def _nearest(self) -> NDArray[np.int64]:
        """Nearest free cell of every cell, (2, X, Y)."""
        found: Any = ndimage.distance_transform_edt(
            ~self.free, return_distances=False, return_indices=True
        )
        return found

    def _free_goals(self, goals_m: Any) -> Array | NDArray[np.bool_]:
        """Moves goals of `geodesic_field` to free positions; empty without goals."""
        if goals_m.dtype != bool:
            return np.unique(np.round(self.nearest_free(np.atleast_2d(goals_m)), 5), axis=0)
        if not goals_m.any():
            return np.zeros((0, 2))
        x, y = self._nearest[:, goals_m]
        free = np.zeros_like(self.free)
        free[x, y] = True
        return free

    def _from_point(self, goal_m: Array) -> Array:
        """Returns the distances (X, Y) from a free point (2,).

        A wavefront starts at the centre of a cell, so the distances from the free cells around the
        point are interpolated bilinearly, which is valid as distance is symmetric.
        """
        grid = np.clip(self._grid(goal_m), 0, np.array(self.free.shape) - 1)
        first = np.minimum(np.floor(grid).astype(int), np.array(self.free.shape) - 2)
        field, total = np.zeros(self.free.shape), 0.0
        for corner in _CORNERS:
            x, y = (first + corner).tolist()
            weight = float(np.abs(1 - corner - (grid - first)).prod())
            if weight > _LEAST_WEIGHT and self.free[x, y]:
                field += weight * self._from_cell(x, y)
                total += weight
        field /= total
        near = (field <= _NEAR_M) & self.free
        cells = np.argwhere(near)
        field[near] = np.linalg.norm(self.positions(cells) - goal_m, axis=1)
        return np.where(self.free, field, np.inf)

    def _from_cell(self, x: int, y: int) -> Array:
        """Returns the distances (X, Y) from the centre of a free cell."""
        speed, step = np.where(self.free, 1.0, SLOW), (CELL_M, CELL_M)
        bend = eikonalfm.factored_fast_marching(speed, (x, y), step, 2)
        return bend * eikonalfm.distance(speed.shape, step, (x, y), indexing="ij")

    def _from_cells(self, goals: NDArray[np.bool_]) -> list[Array]:
        """Returns the distances (X, Y) from each connected group of free cells."""
        groups: Any = ndimage.label(goals, structure=np.ones((3, 3)))
        found = []
        for number in range(1, groups[1] + 1):
            group = groups[0] == number
            speed = np.where(self.free, np.where(group, FAST, 1.0), SLOW)
            x, y = np.argwhere(group)[0].tolist()
            field = eikonalfm.fast_marching(speed, (x, y), (CELL_M, CELL_M), 2)
            field[group] = 0.0
            found.append(np.where(self.free, field, np.inf))
        return found


def _corners(layout: Layout) -> Array:
    """Returns the points (C, 2) that a map of a layout has to cover."""
    bodies = list(layout.placed.values())
    stage = [body for body in bodies if body.piece == STAGE]
    return np.concatenate([body.points_m[:2].T for body in stage or bodies])


@lru_cache(maxsize=32)
def _walls(layout: Layout) -> NDArray[np.bool_]:
    """Returns the cells (X, Y) with walls, which do not depend on doors and drawers."""
    stage = [body for body in layout.placed.values() if body.piece == STAGE]
    outlines = [outline for body in stage for outline in body.outlines_m]
    return floor_between(outlines, _corners(layout)).clearance_m == 0


KEPT_MAPS = 64


class LayoutMaps:
    """Creates the maps for Navigate's distances; the latest ones are cached."""

    def __init__(self, load: Callable[[str], SceneSpec]) -> None:
        """`load` reads a layout."""
        self._load = load
        self._layouts: dict[str, Layout] = {}
        self._maps: OrderedDict[Hashable, NavigationMap] = OrderedDict()

    def of(self, scene_id: str, joints: Mapping[str, Mapping[str, float]]) -> NavigationMap:
        """Returns the map of a layout with these joints: furniture -> joint -> [m or rad]."""
        opened = {
            (furniture, joint): value
            for furniture, values in joints.items()
            for joint, value in values.items()
        }
        key = f"{scene_id} {sorted(opened.items())}"

        def make() -> NavigationMap:
            return NavigationMap.of_layout(self._layout(scene_id), opened)

        return recalled(self._maps, key, make, KEPT_MAPS)

    def _layout(self, scene_id: str) -> Layout:
        if scene_id not in self._layouts:
            self._layouts[scene_id] = Layout.of(self._load(scene_id))
        return self._layouts[scene_id]


_STEPS = np.array([(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)])
_LENGTHS = np.linalg.norm(_STEPS, axis=1)


def path_between(map_: NavigationMap, start_m: Array, goal_m: Array) -> Array:
    """Returns the shortest path from a point (2,) to another.

    It descends the goal's distance field from cell to cell, and then removes waypoints that a
    straight segment can skip.

    Returns:
        Waypoints (W, 2), `start_m` first. If `start_m` is not free, the second is the nearest free
        position; the last is the free position nearest to `goal_m`. All segments between free
        positions are free.
    """
    start, goal = map_.nearest_free(start_m), map_.nearest_free(goal_m)
    cells = descend(map_.geodesic_field(goal), map_.cells_of(start))
    points = np.concatenate((start[None], map_.positions(cells), goal[None]))
    kept = [0]
    for index in range(2, len(points)):
        if not map_.clear(points[kept[-1]], points[index]):
            kept.append(index - 1)
    waypoints = points[[*kept, len(points) - 1]]
    if map_.is_free(start_m):
        return waypoints
    return np.concatenate((np.asarray(start_m, dtype=float)[None, :2], waypoints))


def descend(field: Array, start: NDArray[np.int64], most: int | None = None) -> NDArray[np.int64]:
    """Returns the cells (C, 2) of steepest descent of a distance field, without `start`.

    The field (X, Y) is inf where the floor is not free; `start` (2,) is a free cell. Without
    `most` cells, it descends to the goal.
    """
    ringed = np.pad(field, 1, constant_values=np.inf)
    cell = start + 1
    passed = []
    while most is None or len(passed) < most:
        around = cell + _STEPS
        values = ringed[around[:, 0], around[:, 1]]
        # A diagonal step must not cut the corner of an obstacle.
        sides = np.isfinite(ringed[cell[0] + _STEPS[:, 0], cell[1]])
        sides &= np.isfinite(ringed[cell[0], cell[1] + _STEPS[:, 1]])
        slope = np.where(sides, (ringed[tuple(cell)] - values) / _LENGTHS, -np.inf)
        if slope.max() <= 0:
            break
        cell = around[int(slope.argmax())]
        passed.append(cell)
    return np.array(passed, dtype=np.int64).reshape(-1, 2) - 1


NEAREST_M, FARTHEST_M = 0.45, 1.1
"""Range of horizontal distances from the base to points that the arm can reach."""

_AT_TARGET_M = 0.1
"""Walls within this distance of the target do not occlude it, as furniture is wall-mounted."""


def poses_reaching(
    map_: NavigationMap,
    target_m: Array,
    nearest_m: float = NEAREST_M,
    farthest_m: float = FARTHEST_M,
) -> Array:
    """Returns base poses from which a receptacle, an object or a handle can be reached.

    The line from base to target, (2,) or (3,) in the world, crosses free floor and then only the
    furniture that carries the target: no wall, and no gap behind other furniture.

    Returns:
        (K, 3): x, y and the yaw [rad] that faces the target, nearest first.
    """
    target = np.asarray(target_m, dtype=float)[:2]
    bases = map_.positions(np.argwhere(map_.free))
    gap = target - bases
    distance = np.linalg.norm(gap, axis=1)
    near = np.flatnonzero((distance >= nearest_m) & (distance <= farthest_m))
    near = near[np.argsort(distance[near], kind="stable")]
    near = near[_in_sight(map_, bases[near], target, distance[near])]
    yaw = np.arctan2(gap[near, 1], gap[near, 0])
    return np.column_stack((bases[near], yaw))


def _in_sight(
    map_: NavigationMap, bases_m: Array, target_m: Array, distance_m: Array
) -> NDArray[np.bool_]:
    """Whether only the target's furniture is on the line from bases (K, 2)."""
    count = 1 + int(np.ceil(2 * distance_m.max(initial=0.0) / CELL_M))
    share = np.linspace(0.0, 1.0, 1 + count)
    line = bases_m[:, None] + share[:, None] * (target_m - bases_m)[:, None]
    x, y = np.moveaxis(map_.cells_of(line), -1, 0)
    taken = map_.floor.clearance_m[x, y] == 0
    wall = map_.walls[x, y] & ((1 - share) * distance_m[:, None] > _AT_TARGET_M)
    left_again = taken[:, :-1] & ~taken[:, 1:]
    return ~wall.any(axis=1) & ~left_again.any(axis=1)
