"""Navigation maps of layouts, with geodesic distances (Navigate's measure, S H.2).

Space is free where the disc that models the base fits between all collision shapes. Distances solve
the eikonal equation by the fast marching method (eikonalfm) over the free cells, so they are those
of smooth paths, not of steps on a grid.
"""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping
from functools import cached_property, lru_cache
from typing import Any

import eikonalfm
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hab_tasks.arrays import Floats
from hab_tasks.constants import BASE_RADIUS_M
from hab_tasks.errors import GenerationError
from hab_tasks.privileged import Array, CollisionBody
from hab_tasks.world.scenes.floor import CELL_M, FreeFloor, floor_between, free_floor
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
_fields: OrderedDict[str, Array] = OrderedDict()


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
        radius_m: float = BASE_RADIUS_M,
    ) -> NavigationMap:
        """Maps a layout from all obstacles, at poses (4, 4) by body name."""
        bodies = list(bodies)
        floor = free_floor(bodies, world_from_body, radius_m)
        stage = [body for body in bodies if body.group == "stage"]
        if not stage:
            return NavigationMap(floor, np.zeros_like(floor.room))
        return NavigationMap(floor, free_floor(stage, world_from_body).clearance_m == 0)

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
        if key not in _fields:
            if goals.dtype == bool:
                fields = self._from_cells(goals)
            else:
                fields = [self._from_point(goal) for goal in goals]
            _fields[key] = np.minimum.reduce(fields)
            _fields[key].setflags(write=False)
            if len(_fields) > KEPT_FIELDS:
                _fields.popitem(last=False)
        _fields.move_to_end(key)
        return _fields[key]

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
        self._maps: OrderedDict[str, NavigationMap] = OrderedDict()

    def of(self, scene_id: str, joints: Mapping[str, Mapping[str, float]]) -> NavigationMap:
        """Returns the map of a layout with these joints: furniture -> joint -> [m or rad]."""
        opened = {
            (furniture, joint): value
            for furniture, values in joints.items()
            for joint, value in values.items()
        }
        key = f"{scene_id} {sorted(opened.items())}"
        if key not in self._maps:
            self._maps[key] = NavigationMap.of_layout(self._layout(scene_id), opened)
            if len(self._maps) > KEPT_MAPS:
                self._maps.popitem(last=False)
        self._maps.move_to_end(key)
        return self._maps[key]

    def _layout(self, scene_id: str) -> Layout:
        if scene_id not in self._layouts:
            self._layouts[scene_id] = Layout.of(self._load(scene_id))
        return self._layouts[scene_id]


_NOWHERE = np.zeros((2, 2), dtype=np.float32)


class GeodesicDistances:
    """Geodesic distances to one goal per row; rows without a goal have distance zero."""

    def __init__(self, count: int) -> None:
        self._fields: list[Floats] = [_NOWHERE] * count
        self._origins_m = np.zeros((count, 2), dtype=np.float32)

    def set_goal(self, row: int, map_: NavigationMap, goal_m: Array) -> None:
        """Sets the goal of a row to `goal_m` (2,), or the nearest free position."""
        field = map_.geodesic_field(np.asarray(goal_m, dtype=float))
        self._fields[row] = map_.everywhere(field).astype(np.float32)
        self._origins_m[row] = map_.floor.origin_m

    def distance_m(self, base_m: Floats) -> Floats:
        """Returns distances of bases (N, 2) to their goals, (N,) [m], bilinear between cells."""
        return np.array(
            [self._of_row(row, x, y) for row, (x, y) in enumerate(base_m.tolist())],
            dtype=np.float32,
        )

    def _of_row(self, row: int, x_m: float, y_m: float) -> float:
        """Looks up one row in plain numbers, which takes a tenth of the time of arrays."""
        field, (x0, y0) = self._fields[row], self._origins_m[row].tolist()
        x = min(max((x_m - x0) / CELL_M, 0.0), field.shape[0] - 1.0)
        y = min(max((y_m - y0) / CELL_M, 0.0), field.shape[1] - 1.0)
        i, j = min(int(x), field.shape[0] - 2), min(int(y), field.shape[1] - 2)
        u, v = x - i, y - j
        (a, b), (c, d) = field[i : i + 2, j : j + 2].tolist()
        return (a * (1 - v) + b * v) * (1 - u) + (c * (1 - v) + d * v) * u
