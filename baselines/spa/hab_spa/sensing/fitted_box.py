"""Best-fit box of an object's points, and box of the held object (S App. D, SPA: Pick)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from hab_spa.sensing.voxels import first_in_voxels, voxel_keys
from hab_spa.shapes import Array, invert_pose
from hab_tasks.privileged import CollisionBody, CollisionShape


@dataclass(frozen=True, kw_only=True)
class BoxConfig:
    """Parameters of the fit.

    Attributes:
        reach_m: Maximum distance of the object's points from its position.
        support_reach_m: Horizontal search radius for the supporting plane.
        support_bin_m: Resolution of the plane's height.
        support_share: Minimum share of the points below and around that are in the plane.
        above_m: Minimum height of the object's points above the plane.
        grain_m: Voxel size for downsampling.
        link_m: Maximum distance of neighbours in one cluster.
        yaw_steps: Number of yaw angles compared within a quarter turn.
        facing: A side is visible if the cosine of the viewing angle to its normal exceeds this.
        uneven_m: Maximum asymmetry of the width, seen from the camera.
        trim: Share of the points that may be outside the box on each side.
        smallest_m: Minimum half size of the box.
        fewest: Minimum number of points of a cluster; with fewer, the box has the minimum size.
        others_reach_m: Search radius for other objects.
        thing_m: Maximum extent of another object that can be grasped.
        held_most_m: Search radius for the parts of an object held at the start ...
        held_middle_m: ... and the maximum distance of the middle of a part.
        held_reach_m: Maximum distance of its points if it touches furniture.
    """

    reach_m: float = 0.15
    support_reach_m: float = 0.3
    support_bin_m: float = 0.005
    support_share: float = 0.2
    above_m: float = 0.008
    grain_m: float = 0.006
    link_m: float = 0.015
    yaw_steps: int = 30
    facing: float = 0.3
    uneven_m: float = 0.015
    trim: float = 0.01
    smallest_m: float = 0.02
    fewest: int = 8
    others_reach_m: float = 0.35
    thing_m: float = 0.3
    held_most_m: float = 0.3
    held_middle_m: float = 0.1
    held_reach_m: float = 0.14


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedBox:
    """An upright box in the world.

    Attributes:
        world_from_box: (4, 4) pose of its centre.
        half_size_m: (3,) half extents.
        support_m: Height of the supporting plane; None if none was found.
        seen: Whether the box was fitted to points.
    """

    world_from_box: Array
    half_size_m: Array
    support_m: float | None = None
    seen: bool = True

    def upper_face_centres_m(self) -> Array:
        """Returns the centres (5, 3) of the top and the four sides, in the world."""
        half = np.diag(self.half_size_m)
        local = np.concatenate((half[2:], half[:2], -half[:2]))
        return local @ self.world_from_box[:3, :3].T + self.world_from_box[:3, 3]

    def contains(self, points_m: Array, margin_m: float) -> NDArray[np.bool_]:
        """Whether points (K, 3) are inside the box, enlarged by `margin_m`."""
        return in_box(points_m, self.world_from_box, self.half_size_m + margin_m)


def in_box(points_m: Array, world_from_box: Array, half_size_m: Array) -> NDArray[np.bool_]:
    """Whether points (K, 3) are inside a box of pose (4, 4) and half size (3,)."""
    box_from_world = invert_pose(world_from_box)
    local = points_m @ box_from_world[:3, :3].T + box_from_world[:3, 3]
    return np.all(np.abs(local) <= half_size_m, axis=1)


def fit_box(points_m: Array, centre_m: Array, eye_m: Array, config: BoxConfig) -> FittedBox:
    """Fits an upright box to the points of the object at a position.

    Only the near side of an object is visible; the box is assumed to be symmetric about the
    object's position.

    Args:
        points_m: (K, 3) all seen points, in the world.
        centre_m: (3,) the object's position.
        eye_m: (3,) the viewpoint.
        config: Parameters.
    """
    support_m = support_height_m(points_m, centre_m, config)
    own_m = _object_points(points_m, centre_m, support_m, config)
    own_m = _evenly_wide(own_m, centre_m, eye_m, config)
    if len(own_m) < config.fewest:
        pose = np.eye(4)
        pose[:3, 3] = centre_m
        half_size_m = np.full(3, config.smallest_m)
        return FittedBox(
            world_from_box=pose, half_size_m=half_size_m, support_m=support_m, seen=False
        )
    yaws = np.linspace(0.0, np.pi / 2, config.yaw_steps, endpoint=False)
    axes = np.stack((np.cos(yaws), np.sin(yaws)), axis=1)  # (Y, 2)
    across = np.stack((-axes[:, 1], axes[:, 0]), axis=1)
    half_m = np.stack(
        [_half_m(own_m, centre_m, eye_m, sides, config) for sides in (axes, across)], axis=1
    )  # (Y, 2)
    best = int(half_m.prod(axis=1).argmin())
    offsets_m = np.abs((own_m - centre_m)[:, :2] @ np.stack((axes[best], across[best]), axis=1))
    within = (offsets_m <= half_m[best] + config.grain_m).all(axis=1)
    own_m = own_m[within] if within.any() else own_m
    top_m = float(np.quantile(own_m[:, 2], 1.0 - config.trim))
    bottom_m = min(float(own_m[:, 2].min()), centre_m[2])
    if support_m is not None:
        bottom_m = support_m
    pose = np.eye(4)
    pose[:2, 0], pose[:2, 1] = axes[best], across[best]
    pose[:3, 3] = (*centre_m[:2], (top_m + bottom_m) / 2)
    half = np.array((*half_m[best], (top_m - bottom_m) / 2))
    return FittedBox(
        world_from_box=pose, half_size_m=np.maximum(half, config.smallest_m), support_m=support_m
    )


def support_height_m(points_m: Array, centre_m: Array, config: BoxConfig) -> float | None:
    """Returns the height of the supporting plane below a position (3,), None if there is none."""
    sideways_m = np.linalg.norm(points_m[:, :2] - centre_m[:2], axis=1)
    below_m = centre_m[2] - points_m[:, 2]
    around = (sideways_m < config.support_reach_m) & (below_m > 0.0) & (below_m < config.reach_m)
    heights_m = points_m[around, 2]
    if len(heights_m) < config.fewest:
        return None
    bins = np.floor(heights_m / config.support_bin_m).astype(int)
    counts = np.bincount(bins - bins.min())
    # A plane may be spread over two bins.
    pairs = counts + np.append(counts[1:], 0)
    best = int(pairs.argmax())
    if pairs[best] < config.support_share * len(heights_m):
        return None
    chosen = np.isin(bins - bins.min(), (best, best + 1))
    return float(np.median(heights_m[chosen]))


def other_things_m(points_m: Array, centre_m: Array, box: FittedBox, config: BoxConfig) -> Array:
    """Returns the approximate positions (T, 3) of other small objects around an object.

    Args:
        points_m: (K, 3) all seen points, in the world.
        centre_m: (3,) the object's position.
        box: The object's box.
        config: Parameters.
    """
    near = np.linalg.norm(points_m - centre_m, axis=1) < config.others_reach_m
    if box.support_m is not None:
        near &= points_m[:, 2] > box.support_m + config.above_m
    near_m = points_m[near]
    near_m = near_m[~box.contains(near_m, config.link_m)]
    found = []
    for thing_m in _things(near_m, config):
        lower_m, upper_m = thing_m.min(axis=0), thing_m.max(axis=0)
        if (upper_m - lower_m).max() < config.thing_m:
            found.append((lower_m + upper_m) / 2)
    return np.array(found).reshape(-1, 3)


def _object_points(
    points_m: Array, centre_m: Array, support_m: float | None, config: BoxConfig
) -> Array:
    """Returns the cluster of points above the plane that is nearest to the position."""
    near = np.linalg.norm(points_m - centre_m, axis=1) < config.reach_m
    if support_m is not None:
        near &= points_m[:, 2] > support_m + config.above_m
    found = _things(points_m[near], config)
    if not found:
        return np.zeros((0, 3))
    return min(found, key=lambda thing_m: np.linalg.norm(thing_m - centre_m, axis=1).min())


def _half_m(own_m: Array, centre_m: Array, eye_m: Array, sides: Array, config: BoxConfig) -> Array:
    """Returns half widths (Y,) of an object in directions (Y, 2), from the visible side."""
    view = (eye_m - centre_m)[:2] / np.linalg.norm((eye_m - centre_m)[:2])
    facing = sides @ view
    toward = np.where(facing[:, None] >= 0.0, sides, -sides)
    along_m = (own_m[:, :2] - centre_m[:2]) @ toward.T
    near_m = np.quantile(along_m, 1.0 - config.trim, axis=0)
    far_m = -np.quantile(along_m, config.trim, axis=0)
    # In other directions both sides are visible, but another object may touch one of them.
    half_m = np.where(np.abs(facing) > config.facing, near_m, np.minimum(near_m, far_m))
    return np.maximum(half_m, config.smallest_m)


def _evenly_wide(own_m: Array, centre_m: Array, eye_m: Array, config: BoxConfig) -> Array:
    """Removes points that extend farther to one side than to the other: a neighbouring object."""
    ahead_m = centre_m[:2] - eye_m[:2]
    sideways = np.array((-ahead_m[1], ahead_m[0])) / np.linalg.norm(ahead_m)
    along_m = (own_m[:, :2] - centre_m[:2]) @ sideways
    half_m = min(along_m.max(initial=0.0), -along_m.min(initial=0.0)) + config.uneven_m
    return own_m[np.abs(along_m) <= half_m]


def _things(points_m: Array, config: BoxConfig) -> list[Array]:
    """Returns clusters of downsampled points (K, 3), without small ones."""
    if not len(points_m):
        return []
    points_m = points_m[first_in_voxels(points_m, config.grain_m)]
    points_m = points_m[np.argsort(voxel_keys(points_m, config.grain_m))]
    pairs = KDTree(points_m).query_pairs(config.link_m, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(points_m), len(points_m)))
    _, labels = connected_components(links, directed=False)
    counts = np.bincount(labels)
    return [points_m[labels == label] for label in np.flatnonzero(counts >= config.fewest)]


def _least_box(points_m: Array, config: BoxConfig) -> tuple[Array, Array]:
    """Returns pose (4, 4) and half size (3,) of the upright box of least area around points."""
    yaws = np.linspace(0.0, np.pi / 2, config.yaw_steps, endpoint=False)
    cosine, sine, zero, one = np.cos(yaws), np.sin(yaws), np.zeros_like(yaws), np.ones_like(yaws)
    turns = np.array([[cosine, -sine, zero], [sine, cosine, zero], [zero, zero, one]])
    turned_m = np.einsum("ki,ijy->ykj", points_m, turns)
    lower_m, upper_m = turned_m.min(axis=1), turned_m.max(axis=1)
    best = int((upper_m - lower_m)[:, :2].prod(axis=1).argmin())
    pose = np.eye(4)
    pose[:3, :3] = turns[:, :, best]
    pose[:3, 3] = pose[:3, :3] @ (lower_m[best] + upper_m[best]) / 2
    return pose, (upper_m[best] - lower_m[best]) / 2


HELD = "held"
"""Name of the box's body."""

HELD_UP = "held_up_in_ee"
"""Entry of an observation, for agents of tasks: (3,) what was up before the object was grasped."""


@dataclass(frozen=True, kw_only=True, eq=False)
class HeldBox:
    """A box of half size (3,), its pose (4, 4) in the end-effector's frame."""

    ee_from_box: Array
    half_size_m: Array

    @classmethod
    def find(
        cls, points_m: Array, world_from_ee: Array, config: BoxConfig, up: Array | None = None
    ) -> HeldBox | None:
        """Fits a box to an object held at the start; None if too little is seen of it.

        It is upright, or stands along a direction `up` (3,) of the end-effector's frame.

        The fingers hide its middle, so that its parts on both sides of the hand are looked for
        among world points (K, 3). If it touches furniture, the points near the hand are its own.
        """
        local_m = points_m - world_from_ee[:3, 3]
        found = _things(local_m[np.linalg.norm(local_m, axis=1) < config.held_most_m], config)
        own = [
            thing_m
            for thing_m in found
            if np.ptp(thing_m, axis=0).max() < config.thing_m
            and np.linalg.norm(thing_m.mean(axis=0)) < config.held_middle_m
        ]
        if found and not own:
            thing_m = min(found, key=lambda thing_m: np.linalg.norm(thing_m, axis=1).min())
            own = [thing_m[np.linalg.norm(thing_m, axis=1) < config.held_reach_m]]
        own_m = np.concatenate([np.zeros((0, 3)), *own])
        if len(own_m) < config.fewest:
            return None
        # Turned so that the box is upright.
        turned_from_world = np.eye(4)
        if up is not None:
            aligned = Rotation.align_vectors(np.eye(3)[2:], [world_from_ee[:3, :3] @ up])
            turned_from_world[:3, :3] = aligned[0].as_matrix()
        turned_from_box, half_size_m = _least_box(own_m @ turned_from_world[:3, :3].T, config)
        world_from_box = turned_from_world.T @ turned_from_box
        world_from_box[:3, 3] += world_from_ee[:3, 3]
        return cls(ee_from_box=invert_pose(world_from_ee) @ world_from_box, half_size_m=half_size_m)

    def contains(
        self,
        points_m: Array,
        world_from_ee: Array,
        margin_m: float = 0.0,
        largest_m: float = np.inf,
    ) -> NDArray[np.bool_]:
        """Whether world points (K, 3) are inside the box.

        Args:
            points_m: The points.
            world_from_ee: Pose (4, 4) of the end-effector.
            margin_m: Enlargement of the box, ...
            largest_m: ... after limiting its half size to this.
        """
        half_m = np.minimum(self.half_size_m, largest_m) + margin_m
        return in_box(points_m, world_from_ee @ self.ee_from_box, half_m)

    def body(self, largest_m: float) -> CollisionBody:
        """Returns the box as a collision body, with its half size limited to `largest_m`."""
        box = CollisionShape(
            kind="box",
            body_from_shape=np.eye(4),
            half_size_m=np.minimum(self.half_size_m, largest_m),
            vertices_m=np.zeros((0, 3)),
            faces=np.zeros((0, 3), dtype=np.int64),
        )
        return CollisionBody(name=HELD, group="object", shapes=(box,))
