"""Finds the fridge in depth images: its pose, the side of its handle, and how far it is open.

Vertical planes before the place that is inside the fridge are candidates for its front. Along each,
the known shape is moved to where it fits best, and then everywhere near by. Only the closed fridge
is symmetric; what stands out before an edge of the front is the handle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hab_spa.sensing.cloud import DepthView
from hab_spa.sensing.known_fridge import (
    HANDLES,
    MOST_RAD,
    STRIP_M,
    WIDTH_M,
    Outline,
    hinges_of,
    outline,
)
from hab_spa.shapes import Array, invert_pose
from hab_tasks.world.raycast.compiled import load

COARSE_M, FINE_M = 0.1, 0.045
"""Spacings of the points on the shape."""

BEFORE_M = 0.09
"""What stands out at an edge of the front by less is its handle."""

ALONG_M = np.arange(-0.24, 0.25, 0.015)
"""A front is moved along itself by as much."""

OPENINGS, SEEN_SCORE = 47, 40.0
"""Number of openings that are tried, and least difference that tells one from another."""

LOWER_TOP_M = 0.9
"""Below, the fridge is closed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Images:
    """Depth images, of one moment or of something that has not moved since.

    Attributes:
        depth_m: (V, H, W); NaN where they show the robot.
        cameras: (V, 16) as in `hab_spa.sensing.fit_kernel.fit`.
        points_m: (P, 3) surfaces other than the robot's, in the world.
    """

    depth_m: Array
    cameras: Array
    points_m: Array

    @classmethod
    def joined(cls, images: Sequence[Images]) -> Images:
        """Joins images of several moments."""
        return cls(
            depth_m=np.concatenate([one.depth_m for one in images]),
            cameras=np.concatenate([one.cameras for one in images]),
            points_m=np.concatenate([one.points_m for one in images]),
        )

    @classmethod
    def of(cls, views: Sequence[DepthView], own: Sequence[NDArray[np.bool_]]) -> Images:
        """Joins views, with masks (H, W) of the robot's own pixels."""
        depths, cameras, points = [], [], []
        for view, mine in zip(views, own, strict=True):
            camera_from_world = invert_pose(view.world_from_camera)
            rotation, translation = camera_from_world[:3, :3].ravel(), camera_from_world[:3, 3]
            cameras.append((*view.focal_px, *view.centre_px, *rotation, *translation))
            depths.append(np.where(mine, np.nan, view.depth_m))
            points.append(view.points_m[np.isfinite(view.depth_m) & ~mine])
        return cls(
            depth_m=np.stack(depths),
            cameras=np.array(cameras, dtype=float),
            points_m=np.concatenate(points),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """A fridge that was found.

    Attributes:
        pose: (4,) see `hab_spa.sensing.known_fridge`.
        side: Side of the handle.
        score: How well it fits.
    """

    pose: Array
    side: int
    score: float


@dataclass(frozen=True, kw_only=True)
class FitConfig:
    """Parameters of finding.

    Attributes:
        planes: Number of planes, ...
        least_cells: ... each with at least so many occupied cells, of this size ...
        cell_m: ... and in steps of so much.
        around_rad: A front's normal is at most so far from the direction to the robot.
        before_m: Distances of a front from what is inside.
        beside_m: Most lateral distance of the front's middle from it, ...
        step_m: ... in such steps; ...
        near_m: ... a fit may exceed these by so much.
        starts: Number of places from which the shape is fitted.
        rounds: Tolerance [m], spacing [m], spread of the samples and their number, for each round.
        spread: Standard deviations out of the front, along it [m], in yaw and opening [rad].
        handle: Score of a handle that is seen where it belongs ...
        handle_points: ... with at least so many points.
        least_score, least_closed: Minimum score, and that of a closed fridge, which shows more.
    """

    planes: int = 8
    least_cells: int = 15
    cell_m: float = 0.03
    around_rad: float = np.pi / 4
    before_m: tuple[float, float] = (0.1, 0.64)
    beside_m: float = 0.34
    step_m: float = 0.015
    near_m: float = 0.03
    starts: int = 12
    rounds: tuple[tuple[float, float, float, int], ...] = (
        (0.03, COARSE_M, 0.5, 80),
        (0.02, FINE_M, 0.3, 100),
        (0.012, FINE_M, 0.25, 150),
        (0.01, FINE_M, 0.12, 150),
        (0.01, FINE_M, 0.06, 100),
        (0.01, FINE_M, 0.03, 80),
    )
    spread: tuple[float, float, float, float] = (0.02, 0.06, 0.12, 0.15)
    handle: float = 200.0
    handle_points: int = 10
    least_score: float = 250.0
    least_closed: float = 500.0


def find_fridge(
    images: Images,
    inside_m: Array,
    base_m: Array,
    opened: bool,
    config: FitConfig | None = None,
) -> Found | None:
    """Returns the fridge that a place (3,) is in, as seen by a robot at (2,); None if unseen.

    Args:
        images: What the robot sees.
        inside_m: The place.
        base_m: The robot's base, from where the front is seen.
        opened: Whether the upper door may be open.
        config: Parameters.
    """
    config, rng = config or FitConfig(), np.random.default_rng(0)
    starts = _starts(images, inside_m, base_m, opened, config)
    if opened:
        found = [
            one for start in starts for one in _with_door(images, start, inside_m, config, rng)
        ]
        most = sorted(found, key=lambda one: -one.score)[: config.starts // 2]
        later = replace(config, rounds=config.rounds[1:])
        found = [_refined(images, one.pose, one.side, inside_m, later, rng, "all") for one in most]
    else:
        found = [_refined(images, start, 1, inside_m, config, rng) for start in starts]
    judged = [_with_handle(images, one, opened, config) for one in found]
    best = max(judged, key=lambda one: one.score, default=None)
    least = config.least_score if opened else config.least_closed
    return best if best is not None and best.score >= least else None


def refined(images: Images, found: Found, inside_m: Array, opened: bool) -> Found:
    """Returns a found fridge as it fits more images best; see `find_fridge`."""
    config, rng = FitConfig(), np.random.default_rng(0)
    later = replace(config, rounds=config.rounds[2:])
    moves = "all" if opened else "closed"
    return _refined(images, found.pose, found.side, inside_m, later, rng, moves)


def _with_door(
    images: Images, start: Array, inside_m: Array, config: FitConfig, rng: np.random.Generator
) -> list[Found]:
    """Returns the best opening on either side, after a fit of what does not move."""
    fixed = _refined(
        images, start, 1, inside_m, replace(config, rounds=config.rounds[:3]), rng, "body"
    )
    turned = np.repeat(fixed.pose[None], OPENINGS, axis=0)
    turned[:, 3] = np.linspace(0.0, MOST_RAD, len(turned))
    found = []
    for side in (1, -1):
        scores = _scores(images, outline(FINE_M, side), turned, side, 0.03)
        best = int(scores.argmax())
        found.append(Found(pose=turned[best], side=side, score=float(scores[best])))
    return found


def seen_joint(
    images: Images, found: Found, around_rad: float = 0.5, most_rad: float = MOST_RAD
) -> float | None:
    """Returns how far the door of a found fridge is open now; None if that is not seen."""
    turned = np.repeat(found.pose[None], 41, axis=0)
    joint = found.pose[3]
    low, high = max(0.0, joint - around_rad), min(most_rad, joint + around_rad)
    turned[:, 3] = np.linspace(low, high, len(turned))
    scores = _scores(images, outline(FINE_M, found.side), turned, found.side, 0.02)
    if scores.max() < scores.min() + SEEN_SCORE:
        return None
    return float(turned[scores.argmax(), 3])


def _starts(
    images: Images, inside_m: Array, base_m: Array, opened: bool, config: FitConfig
) -> list[Array]:
    """Returns poses (4,) of fronts along the planes, best first."""
    toward = np.arctan2(*(base_m - inside_m[:2])[::-1])
    points_m = images.points_m
    if opened:
        points_m = points_m[points_m[:, 2] < LOWER_TOP_M]
    aside = np.arange(-config.beside_m, config.beside_m + config.step_m, config.step_m)
    poses = [np.zeros((0, 4))]
    for yaw, out_m in _planes(points_m, inside_m, toward, config):
        x = inside_m[0] + out_m * np.cos(yaw) - aside * np.sin(yaw)
        y = inside_m[1] + out_m * np.sin(yaw) + aside * np.cos(yaw)
        poses.append(np.column_stack((x, y, np.full(len(aside), yaw), np.zeros(len(aside)))))
    stacked = np.concatenate(poses)
    scores = _scores(images, outline(COARSE_M, 1, not opened), stacked, 1, 0.03)
    found: list[Array] = []
    for number in np.argsort(-scores):
        pose = stacked[number]
        if all(np.abs(pose - other)[:3].max() > 0.06 for other in found):
            found.append(pose)
        if len(found) == config.starts:
            break
    return found


def _planes(
    points_m: Array, inside_m: Array, toward_rad: float, config: FitConfig
) -> list[tuple[float, float]]:
    """Returns vertical planes before a place: yaw of the normal and distance, most seen first."""
    gaps_m = points_m - np.append(inside_m[:2], 0.0)
    gaps_m = gaps_m[(np.hypot(gaps_m[:, 0], gaps_m[:, 1]) < 1.1) & (gaps_m[:, 2] > 0.15)]
    cells = np.floor(gaps_m / config.cell_m).astype(int)
    gaps_m = gaps_m[np.unique(cells, axis=0, return_index=True)[1]]
    half_rad = config.around_rad
    yaws = toward_rad + np.linspace(-half_rad, half_rad, 1 + round(np.degrees(half_rad)))
    edges = np.arange(*config.before_m, 0.01)
    counts = np.zeros((len(yaws), len(edges) - 1))
    for row, yaw in enumerate(yaws):
        out_m = np.cos(yaw) * gaps_m[:, 0] + np.sin(yaw) * gaps_m[:, 1]
        along_m = -np.sin(yaw) * gaps_m[:, 0] + np.cos(yaw) * gaps_m[:, 1]
        counts[row] = np.histogram(out_m[np.abs(along_m) < WIDTH_M], edges)[0]
    counts = counts[:, :-1] + counts[:, 1:]
    found: list[tuple[float, float]] = []
    while len(found) < config.planes and counts.max(initial=0.0) > config.least_cells:
        row, column = np.unravel_index(counts.argmax(), counts.shape)
        found.append((float(yaws[row]), float(edges[column + 1])))
        counts[max(0, row - 4) : row + 5, max(0, column - 5) : column + 6] = 0.0
    return found


def _refined(
    images: Images,
    pose: Array,
    side: int,
    inside_m: Array,
    config: FitConfig,
    rng: np.random.Generator,
    moves: str = "closed",
) -> Found:
    """Returns the best pose near one that holds a place, by samples around the best so far."""
    spread = np.array(config.spread) * (1.0, 1.0, 1.0, moves == "all")
    score = -np.inf
    for number, (tolerance_m, spacing_m, share, count) in enumerate(config.rounds):
        away = rng.normal(size=(count, 4)) * spread * share
        away[0] = 0.0
        # Edges fit at one place only, which samples near by may miss.
        if number < 3 and moves != "all":
            along = np.zeros((len(ALONG_M), 4))
            along[:, 1] = ALONG_M
            away = np.concatenate((away, along))
        cosine, sine = np.cos(pose[2]), np.sin(pose[2])
        poses = pose + np.column_stack(
            (
                away[:, 0] * cosine - away[:, 1] * sine,
                away[:, 0] * sine + away[:, 1] * cosine,
                away[:, 2:],
            )
        )
        points = outline(spacing_m, side, moves != "body")
        scores = _scores(images, points, poses, side, tolerance_m)
        # Beside an open door there is room for the fridge's mirror image.
        scores[~_holds(poses, inside_m, config)] = 0.0
        pose, score = poses[scores.argmax()], float(scores.max())
    return Found(pose=pose, side=side, score=score)


def _holds(poses: Array, inside_m: Array, config: FitConfig) -> NDArray[np.bool_]:
    """Whether a place (3,) is in the fridge at poses (K, 4)."""
    gaps_m, cosine, sine = inside_m[:2] - poses[:, :2], np.cos(poses[:, 2]), np.sin(poses[:, 2])
    before_m = -cosine * gaps_m[:, 0] - sine * gaps_m[:, 1]
    beside_m = np.abs(cosine * gaps_m[:, 1] - sine * gaps_m[:, 0])
    nearest_m, farthest_m = config.before_m
    inside = (before_m > nearest_m - config.near_m) & (before_m < farthest_m + config.near_m)
    return inside & (beside_m < config.beside_m + config.near_m)


def _with_handle(images: Images, found: Found, opened: bool, config: FitConfig) -> Found:
    """Returns a fridge with its handle's side, and a higher score if the handle is seen."""
    x, y, yaw, _ = found.pose
    gaps_m = images.points_m - (x, y, 0.0)
    out_m = np.cos(yaw) * gaps_m[:, 0] + np.sin(yaw) * gaps_m[:, 1]
    along_m = -np.sin(yaw) * gaps_m[:, 0] + np.cos(yaw) * gaps_m[:, 1]
    low, high = HANDLES
    bottom_m = low[0][2] - low[1][2] / 2
    top_m = LOWER_TOP_M if opened else high[0][2] + high[1][2] / 2 + 0.1
    stands_out = (out_m > 0.02) & (out_m < BEFORE_M)
    stands_out &= (gaps_m[:, 2] > bottom_m) & (gaps_m[:, 2] < top_m)
    beside_m = along_m[stands_out]
    edge_m = WIDTH_M / 2
    counts = {
        side: int((np.abs(side * beside_m - edge_m + STRIP_M / 2) < STRIP_M / 2 + 0.02).sum())
        for side in (1, -1)
    }
    side = found.side if opened else max(counts, key=lambda one: counts[one])
    seen = counts[side] >= config.handle_points
    return replace(found, side=side, score=found.score + config.handle * seen)


def _scores(images: Images, points: Outline, poses: Array, side: int, tolerance_m: float) -> Array:
    """Returns how well the shape fits at poses (K, 4), (K,)."""
    scores = np.zeros(len(poses))
    _kernel().fit(
        points.points_m, points.normals, points.kind, hinges_of(poses, side), float(side),
        images.depth_m, images.cameras, tolerance_m, scores,
    )  # fmt: skip
    return scores


@lru_cache(maxsize=1)
def _kernel() -> Any:
    """Returns the module `hab_spa.sensing.fit_kernel`, compiled."""
    return load("hab_spa.sensing.fit_kernel", _compile)


def _compile(module: Any) -> None:
    """Fits nothing to no images."""
    none, no_kind = np.zeros((0, 3)), np.zeros(0, dtype=np.int64)
    images, cameras = np.zeros((0, 1, 1)), np.zeros((0, 16))
    module.fit(none, none, no_kind, np.zeros((0, 4)), 1.0, images, cameras, 0.01, np.zeros(0))
