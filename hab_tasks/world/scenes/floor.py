"""Free floor for the robot's base, from the collision geometry.

Clearances are conservative, as in Recast's maps: a cell is an obstacle if a shape reaches into it,
and distances are from the centre of a cell to the edge of the nearest obstacle cell.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from scipy import ndimage
from scipy.spatial import ConvexHull, QhullError

from hab_tasks.constants import BASE_RADIUS_M
from hab_tasks.geometry import BOX_CORNERS
from hab_tasks.privileged import Array, CollisionBody, CollisionShape

CELL_M = 0.05
LOWEST_M, HIGHEST_M = 0.06, 1.3
"""Height range of obstacles to the base (rugs are lower)."""

_FINER = 4
"""Rasterisation subdivides each side of a cell into this many parts."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FreeFloor:
    """Distance from every floor cell to the nearest obstacle.

    Attributes:
        origin_m: World position (2,) of the centre of cell (0, 0).
        clearance_m: (X, Y) distance to the nearest obstacle, 0 on one.
        room: (X, Y) whether the cell belongs to the largest connected area the base can use.
    """

    origin_m: Array
    clearance_m: Array
    room: NDArray[np.bool_]
    _kept: dict[float, Array] = field(default_factory=dict, init=False, repr=False)

    def cells_by_distance(self, point_m: Array, clearance_m: float, nearest_m: float) -> Array:
        """Returns usable positions (K, 2) from `nearest_m` on, nearest to `point_m` (2,) first."""
        positions = self._positions(clearance_m)
        distance = np.linalg.norm(positions - point_m[:2], axis=1)
        order = np.argsort(distance, kind="stable")
        return positions[order[distance[order] >= nearest_m]]

    def cells_around(
        self, point_m: Array, clearance_m: float, nearest_m: float, farthest_m: float
    ) -> Array:
        """Returns those of `cells_by_distance` that are nearer to the point than `farthest_m`."""
        positions = self._positions(clearance_m)
        distance = np.linalg.norm(positions - point_m[:2], axis=1)
        within = (distance >= nearest_m) & (distance < farthest_m)
        return positions[within][np.argsort(distance[within], kind="stable")]

    def nearest_cell(self, point_m: Array) -> Array | None:
        """Returns the usable position (2,) nearest to a point; None if there is none."""
        positions = self._positions(0.0)
        if not len(positions):
            return None
        return positions[np.argmin(np.linalg.norm(positions - point_m[:2], axis=1))]

    def _positions(self, clearance_m: float) -> Array:
        """Returns the usable positions (K, 2) with a minimum clearance."""
        if clearance_m not in self._kept:
            cells = np.argwhere(self.room & (self.clearance_m >= clearance_m))
            self._kept[clearance_m] = self.origin_m + CELL_M * cells
        return self._kept[clearance_m]

    def clearance_at(self, point_m: Array) -> float:
        """Returns the clearance [m] at a position (2,), 0 outside the map."""
        cell = np.round((np.asarray(point_m[:2]) - self.origin_m) / CELL_M).astype(int)
        if (cell < 0).any() or (cell >= self.clearance_m.shape).any():
            return 0.0
        return float(self.clearance_m[tuple(cell)]) if self.room[tuple(cell)] else 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Footprint:
    """Footprint of a convex shape: outline (V, 2), lowest and highest point [m]."""

    outline_m: Array
    low_m: float
    high_m: float

    def in_the_way(self, heights_m: tuple[float, float] = (LOWEST_M, HIGHEST_M)) -> bool:
        """Whether it overlaps a height range."""
        return self.high_m > heights_m[0] and self.low_m < heights_m[1]


@dataclass(frozen=True, kw_only=True, eq=False)
class BodyOutline:
    """Contribution of a body to the map.

    Attributes:
        outlines_m: Convex polygons (V, 2) of its shapes that are in the way.
        ground_m: Points (P, 2) that the map has to cover, of the stage.
    """

    outlines_m: tuple[Array, ...]
    ground_m: tuple[Array, ...]


def free_floor(
    bodies: Iterable[CollisionBody],
    world_from_body: dict[str, Array],
    radius_m: float = BASE_RADIUS_M,
    heights_m: tuple[float, float] = (LOWEST_M, HIGHEST_M),
) -> FreeFloor:
    """Maps the free floor between stage mesh and furniture, at poses (4, 4) by body name.

    `radius_m` is that of the base, `heights_m` the height range of obstacles.
    """
    parts = [body_outline(body, world_from_body[body.name], heights_m) for body in bodies]
    return floor_of(parts, radius_m)


def body_outline(
    body: CollisionBody,
    world_from_body: Array,
    heights_m: tuple[float, float] = (LOWEST_M, HIGHEST_M),
) -> BodyOutline:
    """Returns what a body at a pose (4, 4) contributes to the map; kept, as most bodies rest."""
    return _kept_outline(body, world_from_body.astype(np.float64).tobytes(), heights_m)


@lru_cache(maxsize=4096)
def _kept_outline(body: CollisionBody, pose: bytes, heights_m: tuple[float, float]) -> BodyOutline:
    world_from_body = np.frombuffer(pose).reshape(4, 4)
    outlines: list[Array] = []
    ground: list[Array] = []
    for shape in body.shapes:
        points = (world_from_body @ body_points(shape))[:3]
        if body.group == "stage":
            ground.append(points[:2].T)
        outlines += [f.outline_m for f in footprints(points) if f.in_the_way(heights_m)]
    return BodyOutline(outlines_m=tuple(outlines), ground_m=tuple(ground))


def floor_of(parts: Iterable[BodyOutline], radius_m: float = BASE_RADIUS_M) -> FreeFloor:
    """Maps the free floor between bodies, from their outlines."""
    outlines: list[Array] = []
    ground: list[Array] = []
    for part in parts:
        outlines += part.outlines_m
        ground += part.ground_m
    return floor_between(outlines, np.concatenate(ground or outlines), radius_m)


def footprints(points_m: Array, starts: Iterable[int] = (0,)) -> Iterator[Footprint]:
    """Yields the footprints of shapes with corners (3, P), which start at these indices."""
    for shape in np.split(points_m, list(starts)[1:], axis=1):
        if shape.shape[1]:
            low, high = float(shape[2].min()), float(shape[2].max())
            yield Footprint(outline_m=outline(shape[:2].T), low_m=low, high_m=high)


def floor_between(
    outlines: Iterable[Array], corners: Array, radius_m: float = BASE_RADIUS_M
) -> FreeFloor:
    """Maps the free floor between convex polygons (V, 2), covering the points `corners` (C, 2)."""
    corner = corners.min(axis=0)
    columns, rows = (int(n) for n in np.ceil((corners.max(axis=0) - corner) / CELL_M))
    blocked = np.pad(touched(outlines, corner, (columns, rows)), 1, constant_values=True)
    distance_cells: Any = ndimage.distance_transform_edt(~blocked)
    clearance = CELL_M * np.maximum(distance_cells[1:-1, 1:-1] - 0.5, 0.0)
    return FreeFloor(
        origin_m=corner + CELL_M / 2,
        clearance_m=clearance,
        room=largest_area(clearance >= radius_m),
    )


def touched(
    outlines: Iterable[Array], corner_m: Array, shape: tuple[int, int], depth_m: float = 0.001
) -> NDArray[np.bool_]:
    """Marks the cells (X, Y) that a shape reaches into, of a map that starts at `corner_m`.

    Args:
        outlines: Convex polygons (V, 2).
        corner_m: Lower corner (2,) of cell (0, 0).
        shape: Cells along x and y.
        depth_m: Tolerated overlap of a shape with an unmarked cell; if negative, the minimum
            distance to one.
    """
    image = Image.new("L", (_FINER * shape[0], _FINER * shape[1]), 0)
    draw = ImageDraw.Draw(image)
    for polygon in outlines:
        middle = (polygon.min(axis=0) + polygon.max(axis=0)) / 2
        inward = middle - polygon
        inset = np.sign(inward) * np.minimum(np.abs(inward), depth_m)
        corners = (polygon + inset - corner_m) * (_FINER / CELL_M)
        draw.polygon(corners.ravel().tolist(), fill=1, outline=1)
    fine = np.asarray(image, dtype=bool).T.reshape(shape[0], _FINER, shape[1], _FINER)
    return np.logical_or.reduce(fine, axis=(1, 3))


def largest_area(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Returns the largest connected area of a map (X, Y); empty if there is none."""
    labelled: Any = ndimage.label(cells)
    labels, _ = labelled
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    return cells & (labels == np.argmax(sizes))


@lru_cache(maxsize=8192)
def body_points(shape: CollisionShape) -> Array:
    """Returns the shape's corner points in the body frame as homogeneous columns (4, K)."""
    points = shape.vertices_m if shape.kind == "convex" else BOX_CORNERS * _half_size_m(shape)
    corners = shape.body_from_shape @ np.vstack((points.T, np.ones(len(points))))
    corners.flags.writeable = False
    return corners


def _half_size_m(shape: CollisionShape) -> Array:
    """Returns half the size (3,) of the box around a shape that is not convex."""
    half = shape.half_size_m
    if shape.kind in ("capsule", "cylinder"):
        return np.array([half[0] + half[1], half[0], half[0]])
    return np.full(3, half[0]) if shape.kind == "sphere" else half


def outline(points: Array) -> Array:
    """Returns the corners (V, 2) of the convex hull of points (K, 2), in order."""
    try:
        return points[ConvexHull(points).vertices]
    except QhullError:
        return points


def distance_along(shape: CollisionShape, points_m: Array, direction: Array) -> Array:
    """Returns the distance (K,) [m] of points (K, 3) to a convex shape along a direction (3,).

    Points and direction are in the body's frame; 0 inside the shape, inf without a hit.
    """
    normals, offsets = _planes(shape)
    if not len(normals):
        return np.full(len(points_m), np.inf)
    heights = points_m @ normals.T - offsets  # (K, F), positive outside the face
    slopes = normals @ direction
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = -heights / slopes
    entry = np.where(slopes < 0, crossing, -np.inf).max(axis=1)
    leave = np.where(slopes > 0, crossing, np.inf).min(axis=1)
    beside = ((slopes == 0) & (heights > 0)).any(axis=1)
    missed = beside | (entry > leave) | (leave < 0)
    return np.where(missed, np.inf, np.maximum(entry, 0.0))


@lru_cache(maxsize=8192)
def bounding_ball(body: CollisionBody) -> tuple[Array, float]:
    """Returns centre (3,) in the body's frame and radius [m] of a bounding sphere."""
    points = np.concatenate([body_points(shape)[:3] for shape in body.shapes], axis=1)
    centre = (points.min(axis=1) + points.max(axis=1)) / 2
    return centre, float(np.linalg.norm(points - centre[:, None], axis=0).max())


@lru_cache(maxsize=8192)
def _planes(shape: CollisionShape) -> tuple[Array, Array]:
    """Returns outward normals (F, 3) and offsets (F,) of a shape's faces, in the body's frame."""
    rotation, position = shape.body_from_shape[:3, :3], shape.body_from_shape[:3, 3]
    if shape.kind == "convex":
        a, b, c = (shape.vertices_m[shape.faces[:, i]] for i in range(3))
        normals = np.cross(b - a, c - a)
        length = np.linalg.norm(normals, axis=1)
        normals, a = (normals / length[:, None])[length > 0], a[length > 0]
        offsets = np.einsum("fi,fi->f", normals, a)
        inward = (normals @ shape.vertices_m.mean(axis=0)) > offsets
        normals = np.where(inward[:, None], -normals, normals)
        offsets = np.where(inward, -offsets, offsets)
    elif shape.kind == "plane":
        return np.zeros((0, 3)), np.zeros(0)
    else:
        half = _half_size_m(shape)
        normals, offsets = np.concatenate((np.eye(3), -np.eye(3))), np.concatenate((half, half))
    turned = normals @ rotation.T
    return turned, offsets + turned @ position
