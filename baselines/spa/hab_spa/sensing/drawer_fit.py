"""Finds the drawer that a place is in: the front's plane, the handle along it, and the opening.

The plane is seen well. Where the drawer's middle is along it is known roughly: from the end of the
counter, or from the edges of an open drawer, and always from the place inside.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hab_spa.shapes import Array

TRAVEL_M = 0.5
"""Travel of the drawers of both scene datasets."""

HALF_WIDTH_M = 0.437
"""Half of the drawer's width."""


@dataclass(frozen=True, kw_only=True)
class DrawerFitConfig:
    """Parameters of finding.

    Attributes:
        around_rad: A front's normal is at most so far from the direction to the robot.
        near_m: Farthest surface that counts, from the place.
        heights_m: Heights of the furniture's fronts.
        over_m: The handle is so much above what lies in the drawer ...
        band_m: ... and what is looked at within so much of its height.
        before_m: Distances of the closed front from the place, ...
        out_m: ... and of the front of an open drawer.
        within_m: A plane is looked for so far to the sides of the place.
        beside_m: Most lateral distance of the handle from the place.
        above_m: The front of what is above an open drawer is the counter's from so high above the
            place on.
        handle_m: Distance of the handle from the plane: a bar stands out by 45 mm, a front without
            one is set back by 15 mm.
        cell_m: Side of the cells of a plane.
        full: Share of the heights that are seen where the counter is.
        end_m: Distance of the handle from the end of the counter, on the left seen from inside.
        thick_m: Thickness of what counts as the front of an open drawer, ...
        least_points: ... which has at least so many points.
        joints_m: Openings that an open drawer may seem to have.
        opened_m: The opening, if the counter's plane is not seen.
    """

    around_rad: float = 0.9
    near_m: float = 1.2
    heights_m: tuple[float, float] = (0.1, 0.85)
    over_m: float = 0.03
    band_m: float = 0.05
    before_m: tuple[float, float] = (0.08, 0.6)
    out_m: tuple[float, float] = (0.1, 0.58)
    within_m: float = 0.7
    beside_m: float = 0.35
    above_m: float = 0.14
    handle_m: float = 0.02
    cell_m: float = 0.02
    full: float = 0.3
    end_m: float = 0.465
    thick_m: float = 0.05
    least_points: int = 8
    joints_m: tuple[float, float] = (-0.04, 0.56)
    opened_m: float = 0.45


@dataclass(frozen=True, kw_only=True, eq=False)
class FoundDrawer:
    """A drawer that was found.

    Attributes:
        closed_m: (3,) handle of the closed drawer.
        yaw_rad: Direction in which it opens.
        joint: Opening [m].
    """

    closed_m: Array
    yaw_rad: float
    joint: float

    @property
    def axis(self) -> Array:
        """The direction (3,) in which it opens."""
        return np.array((np.cos(self.yaw_rad), np.sin(self.yaw_rad), 0.0))

    @property
    def aside(self) -> Array:
        """The direction (3,) to the left, as seen from inside."""
        return np.array((-np.sin(self.yaw_rad), np.cos(self.yaw_rad), 0.0))


def find_drawer(
    points_m: Array,
    inside_m: Array,
    base_m: Array,
    opened: bool,
    config: DrawerFitConfig | None = None,
) -> FoundDrawer | None:
    """Returns the drawer that a place (3,) is in, as seen by a robot at (2,); None if unseen.

    Args:
        points_m: Surfaces (P, 3) other than the robot's.
        inside_m: The place.
        base_m: The robot's base.
        opened: Whether the drawer is open.
        config: Parameters.
    """
    config = config or DrawerFitConfig()
    points_m = points_m[np.linalg.norm((points_m - inside_m)[:, :2], axis=1) < config.near_m]
    toward = float(np.arctan2(*(base_m - inside_m[:2])[::-1]))
    plane = _plane(points_m, inside_m, toward, opened, config)
    if plane is None:
        return None
    yaw, plane_m = plane
    found = FoundDrawer(closed_m=inside_m, yaw_rad=yaw, joint=0.0)
    gaps_m = points_m - inside_m
    out_m, along_m, up_m = gaps_m @ found.axis, gaps_m @ found.aside, gaps_m[:, 2]
    joint, handle_m = 0.0, plane_m + config.handle_m
    if opened:
        band = (np.abs(up_m - config.over_m) < config.band_m) & (np.abs(along_m) < 0.8)
        front = _open_front(out_m[band], along_m[band], config)
        if front is None:
            return None
        front_m, aside_m = front
        joint = front_m - handle_m
        if not config.joints_m[0] <= joint <= config.joints_m[1]:
            joint = config.opened_m
        joint = min(max(joint, 0.0), TRAVEL_M)
        handle_m = front_m - joint
    else:
        end_m = _end_m(out_m - plane_m, along_m, points_m[:, 2], config)
        aside_m = 0.0 if end_m is None else end_m - config.end_m
    aside_m = float(np.clip(aside_m, -config.beside_m, config.beside_m))
    closed_m = inside_m + handle_m * found.axis + aside_m * found.aside
    closed_m[2] += config.over_m
    return FoundDrawer(closed_m=closed_m, yaw_rad=yaw, joint=joint)


def _plane(
    points_m: Array, inside_m: Array, toward_rad: float, opened: bool, config: DrawerFitConfig
) -> tuple[float, float] | None:
    """Returns the vertical plane with most surfaces: yaw of its normal, distance from the place."""
    before_m = (0.1 - config.out_m[1], config.before_m[1]) if opened else config.before_m
    high = points_m[:, 2] > inside_m[2] + (config.above_m if opened else -0.1)
    points_m = points_m[high & (points_m[:, 2] < config.heights_m[1])]
    if len(points_m) < config.least_points:
        return None
    cells = np.floor(points_m / 0.03).astype(int)
    gaps_m = points_m[np.unique(cells, axis=0, return_index=True)[1]] - inside_m
    half_rad = config.around_rad
    yaws = toward_rad + np.linspace(-half_rad, half_rad, 1 + 2 * round(np.degrees(half_rad)))
    edges = np.arange(*before_m, 0.01)
    counts = np.zeros((len(yaws), len(edges) - 1))
    for row, yaw in enumerate(yaws):
        out_m = np.cos(yaw) * gaps_m[:, 0] + np.sin(yaw) * gaps_m[:, 1]
        along_m = np.cos(yaw) * gaps_m[:, 1] - np.sin(yaw) * gaps_m[:, 0]
        counts[row] = np.histogram(out_m[np.abs(along_m) < config.within_m], edges)[0]
    counts = counts[:, :-1] + counts[:, 1:]
    row, column = np.unravel_index(counts.argmax(), counts.shape)
    return float(yaws[row]), float(edges[column + 1])


def _end_m(out_m: Array, along_m: Array, height_m: Array, config: DrawerFitConfig) -> float | None:
    """Returns where the counter ends on the left; None if the view ends before."""
    edges = np.arange(-0.4, 1.2, config.cell_m)
    on_plane = np.abs(out_m) < 0.025
    low_m, high_m = config.heights_m
    front = on_plane & (height_m > low_m) & (height_m < high_m)
    rows = np.arange(low_m, high_m + config.cell_m, config.cell_m)
    cells = np.histogram2d(along_m[front], height_m[front], (edges, rows))[0] > 0
    counts = cells.sum(axis=1)
    # A wall beside the counter crosses the plane, also above the counter.
    above = on_plane & (height_m > high_m + 0.05) & (height_m < 2.0)
    walls = np.histogram(along_m[above], edges)[0] >= config.least_points
    full = (counts >= config.full * np.percentile(counts, 90)) & ~walls & (counts > 2)
    end = _end_of_runs(full, round(0.1 / config.cell_m))
    if end is None or not end < len(full) - 1:
        return None
    return float(edges[end + 1])


def _end_of_runs(flags: NDArray[np.bool_], length: int) -> int | None:
    """Returns the last index in a run of at least so many flags."""
    run, last = 0, None
    for index, flag in enumerate(flags):
        run = run + 1 if flag else 0
        last = index if run >= length else last
    return last


def _open_front(
    out_m: Array, along_m: Array, config: DrawerFitConfig
) -> tuple[float, float] | None:
    """Returns where the handle of an open drawer is, ahead of the place and beside it."""
    ahead = (out_m > config.out_m[0]) & (out_m < config.out_m[1])
    if ahead.sum() < config.least_points:
        return None
    front_m = float(np.percentile(out_m[ahead], 97))
    found_m = along_m[ahead & (out_m > front_m - config.thick_m)]
    low_m, high_m = np.percentile(found_m, (2, 98))
    return front_m, float((low_m + high_m) / 2)
