"""Looks with the head camera, and what has changed between two of them.

Where a placed object has come to lie needs no model of it: the camera sees something nearer there
than before. Where one was taken from, it sees something farther.

Before a door or drawer is opened, the robot sees its closed front; where it grasps, it feels the
handle. What is no longer there when it is open was the front; it is closed again if that is seen
where it was.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from hab_spa.sensing.cloud import DepthView, world_from_base
from hab_spa.sensing.fridge_fit import Found, Images, find_fridge, seen_joint
from hab_spa.sensing.known_fridge import MOST_RAD
from hab_spa.sensing.own_shapes import own_shapes
from hab_spa.shapes import Array, invert_pose
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from hab_tasks.agent import of_rows
from hab_tasks.robots.spec import RobotSpec

CHANGED_M = 0.015
"""Least change of depth: the drives let the camera sway by millimetres."""

AROUND_M, LEAST = 0.5, 8
"""What has appeared is looked for so far around, and has so many pixels at least."""

LEVEL_M, RISES_M, HIDDEN_M = 0.1, 0.02, 0.12
"""An object lies on the level of most surfaces so near in height, and is so much higher. Farther
from its goal, what was hidden before may as well be a wall."""

IN_HAND_M = 0.2
"""What is held is seen so near to the hand: grasped up to 15 cm from its centre of mass."""

STANDS_M, LOWEST_M, SAME = 0.04, -0.015, 0.7
"""What is seen around an object's centre of mass, from so far below it, is the object; it still
stands there if so much of it looks the same."""

GONE_M, SURELY_GONE_M = 0.09, 0.05
"""The middle of what is seen of an object is so near to its centre of mass, and rarely that of
another one."""

OTHER_PX, OTHER_M, NEAR_M = 20, 0.3, 0.3
"""What has gone is another object if so much of it was seen, it is not larger, and it was so near.
A door that was pushed is larger."""

HELD_M, OTHER_HELD_M = 0.03, 0.07
"""The target is seen in the hand so near to where it was when the hand closed, another object so
far from there."""

EMPTY_M, PAST_M = 0.06, 0.03
"""A place is empty if one sees nothing so near to it, and so far past it."""

FALLEN_M, FELL_M, ALONE_M = (0.012, 0.25), 0.8, 0.12
"""What has fallen from a place lies so high above the floor, so near to it, and nothing higher is
seen so near to its middle."""

LINK_M, LINK_PX = 0.03, 2.5
"""Pixels beside each other show one surface up to this distance, or so many times their spacing."""

OWN_M, OWN_PX = 0.04, 2
"""Surfaces so near to the robot's own shapes are taken for its own, and pixels so near to these: at
edges a pixel may show either."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Look:
    """A look with the head camera.

    Attributes:
        points_m: (H, W, 3) surfaces in the base frame; NaN beyond the range.
        own: (H, W) whether a pixel shows the robot.
        view: The image, in the world of the camera's pose.
        base_from_world: (4, 4) from that world.
    """

    points_m: Array
    own: NDArray[np.bool_]
    view: DepthView
    base_from_world: Array

    @classmethod
    def take(cls, robot: RobotSpec, obs: Mapping[str, Any], row: int, arm_rad: Array) -> Look:
        """Looks, with the arm at joint positions (J,) [rad]."""
        images = of_rows(obs, [row])
        view = DepthView.read(images, "head", 0)
        base_from_world = invert_pose(world_from_base(robot, images, 0))
        points_m = view.points_m @ base_from_world[:3, :3].T + base_from_world[:3, 3]
        seen, own = np.isfinite(view.depth_m), np.zeros(view.depth_m.shape, dtype=bool)
        shapes = own_shapes(robot)
        own[seen] = shapes.contain(points_m[seen], shapes.poses(np.eye(4), arm_rad), OWN_M)
        own = np.array(ndimage.binary_dilation(own, iterations=OWN_PX), dtype=bool)
        return cls(points_m=points_m, own=own, view=view, base_from_world=base_from_world)

    @property
    def depth_m(self) -> Array:
        """(H, W) distance along the camera's axis; infinite beyond the range."""
        return self.view.depth_m

    @property
    def surfaces_m(self) -> Array:
        """Surfaces (P, 3) in the base frame, other than the robot's."""
        return self.points_m[np.isfinite(self.depth_m) & ~self.own]

    def behind_m(self, points_m: Array) -> tuple[NDArray[np.int64], Array]:
        """Returns which of points (P, 3) are in view, and how far (V,) behind these one sees.

        Points that the robot hides are not in view.
        """
        world_from_base = invert_pose(self.base_from_world)
        in_world_m = points_m @ world_from_base[:3, :3].T + world_from_base[:3, 3]
        which, pixels, depths_m = self.view.project(in_world_m)
        pixels = tuple(pixels.T)
        seen = ~self.own[pixels]
        return which[seen], (self.depth_m[pixels] - depths_m)[seen]

    def appeared(self, before: Look, near_m: Array, hidden: bool = False) -> list[Array]:
        """Returns what has appeared around a point (3,) since a look, as clouds (P, 3).

        Args:
            before: The earlier look.
            near_m: (3,) the point.
            hidden: Whether what was hidden then, by the arm or by what it held, counts if it rises
                above the level of what is around.
        """
        gaps_m = np.linalg.norm(self.points_m - near_m, axis=-1)
        rows, columns = np.nonzero((gaps_m < AROUND_M) & ~self.own)
        # Through the earlier camera, as contact may have turned the base a little meanwhile.
        seen, pixels, depths_m = before.view.project(self.view.points_m[rows, columns])
        then_m = before.depth_m[tuple(pixels.T)]
        new = depths_m < then_m - CHANGED_M
        if hidden:
            heights_m = self.points_m[rows, columns, 2]
            level = heights_m[np.abs(heights_m - near_m[2]) < LEVEL_M]
            level_m = np.median(level) if len(level) else np.inf
            rises = (heights_m > level_m + RISES_M) & (gaps_m[rows, columns] < HIDDEN_M)
            new |= (depths_m > then_m + CHANGED_M) & rises[seen]
        nearer = np.zeros(self.own.shape, dtype=bool)
        nearer[rows[seen[new]], columns[seen[new]]] = True
        # Without lines one pixel wide: a base that sways by a millimetre shifts edges.
        return self._clouds(ndimage.binary_opening(nearer, np.ones((2, 2))))

    def stands(self, after: Look, near_m: Array) -> bool:
        """Returns whether what was seen around a point (3,) is there in a later look."""
        gaps_m = self.points_m - near_m
        around = (np.linalg.norm(gaps_m, axis=-1) < STANDS_M) & (gaps_m[..., 2] > LOWEST_M)
        _, behind_m = after.behind_m(self.moved_to(after, self.points_m[around & ~self.own]))
        same = np.abs(behind_m) < CHANGED_M
        return len(same) >= LEAST and bool(same.mean() > SAME)

    def shows(self, here_m: Array) -> bool:
        """Whether something is seen at a point (3,)."""
        near = np.linalg.norm(self.points_m - here_m, axis=-1) < EMPTY_M
        return int((near & ~self.own).sum()) >= LEAST

    def misses(self, here_m: Array) -> bool:
        """Whether nothing is seen at a point (3,), past which one sees."""
        _, behind_m = self.behind_m(here_m[None])
        return len(behind_m) > 0 and bool(behind_m[0] > PAST_M) and not self.shows(here_m)

    def fallen_m(self, from_m: Array) -> Array | None:
        """Returns the middle (3,) of the small thing on the floor nearest to (3,); None without."""
        heights_m = self.points_m[..., 2]
        aside_m = np.linalg.norm(self.points_m[..., :2] - from_m[:2], axis=-1)
        low_m, high_m = FALLEN_M
        low = (heights_m > low_m) & (heights_m < high_m) & (aside_m < FELL_M) & ~self.own
        above_m = self.points_m[(heights_m > high_m) & (aside_m < FELL_M) & ~self.own][:, :2]
        middles_m = []
        for cloud_m in self._clouds(low):
            gaps_m = np.linalg.norm(above_m - middle_m(cloud_m)[:2], axis=1)
            if np.ptp(cloud_m, axis=0).max() < high_m and gaps_m.min(initial=np.inf) > ALONE_M:
                middles_m.append(middle_m(cloud_m))
        return min(middles_m, key=lambda one_m: np.linalg.norm(one_m - from_m), default=None)

    def held_m(self, ee_m: Array, before: Look | None = None) -> Array | None:
        """Returns the middle (3,) of what is seen in the hand at (3,); None if nothing is.

        If an earlier look is given, with the arm as it is now, only of what has appeared since.
        """
        near = np.linalg.norm(self.points_m - ee_m, axis=-1) < IN_HAND_M
        if before is None:
            seen = self._clouds(near & ~self.own)
        else:
            seen = self.appeared(before, ee_m)
            seen = [one_m for one_m in seen if np.linalg.norm(middle_m(one_m) - ee_m) < IN_HAND_M]
        cloud_m = max(seen, key=len, default=None)
        return None if cloud_m is None else middle_m(cloud_m)

    def _clouds(self, shown: NDArray[Any]) -> list[Array]:
        """Returns the connected parts of some pixels (H, W), as clouds (P, 3).

        Pixels beside each other are not connected where one shows what is behind the other.
        """
        number = np.where(shown, np.cumsum(shown).reshape(shown.shape) - 1, -1)
        pairs = [
            np.stack((number[first], number[second]), axis=-1).reshape(-1, 2)
            for first, second in _BESIDE
        ]
        links = np.concatenate(pairs)
        links = links[(links >= 0).all(axis=1)]
        points_m = self.points_m[shown]
        gaps_m = np.linalg.norm(points_m[links[:, 0]] - points_m[links[:, 1]], axis=1)
        far_m = np.maximum(LINK_M, LINK_PX * self.depth_m[shown] / self.view.focal_px[0])
        links = links[gaps_m < far_m[links[:, 0]]]
        graph = coo_array((np.ones(len(links)), links.T), shape=(len(points_m), len(points_m)))
        _, parts = connected_components(graph, directed=False)
        counts = np.bincount(parts, minlength=1)
        return [points_m[parts == part] for part in np.flatnonzero(counts >= LEAST)]

    def moved_to(self, after: Look, points_m: Array) -> Array:
        """Maps points (P, 3) from the base frame of this look to that of another one."""
        after_from_before = after.base_from_world @ invert_pose(self.base_from_world)
        return points_m @ after_from_before[:3, :3].T + after_from_before[:3, 3]

    def appeared_m(self, before: Look, near_m: Array) -> Array | None:
        """Returns the middle (3,) of what has appeared nearest to a point (3,) since a look.

        Returns:
            None if nothing that is large enough has appeared around the point.
        """
        middles_m = [middle_m(cloud_m) for cloud_m in self.appeared(before, near_m, hidden=True)]
        return min(middles_m, key=lambda middle_m: np.linalg.norm(middle_m - near_m), default=None)


def middle_m(cloud_m: Array) -> Array:
    """Returns the middle (3,) of the box around a cloud (P, 3)."""
    return (cloud_m.min(axis=0) + cloud_m.max(axis=0)) / 2


NEARER_M = 0.015
"""The middle of an object is so much farther than that of what is seen of it, on average."""


def outward(seen_m: Array) -> Array:
    """Returns the middle (3,) of an object from that of what is seen of it, in the base frame."""
    away = seen_m[:2] / np.linalg.norm(seen_m[:2])
    return np.append(seen_m[:2] + NEARER_M * away, seen_m[2])


def is_other(before: Look, after: Look, here_m: Array, aside_m: float | None) -> bool:
    """Whether the hand has taken something else between two looks than what was at a point (3,).

    Args:
        before: The look before.
        after: The look after.
        here_m: The point, in the base frame of the look after.
        aside_m: Distance of what is seen in the hand from where the target would be; None if
            nothing is.
    """
    if aside_m is not None and aside_m < HELD_M:
        return False
    # What has gone is what was nearer before.
    gone = [before.moved_to(after, one_m) for one_m in before.appeared(after, here_m)]
    gaps_m = [float(np.linalg.norm(middle_m(cloud_m) - here_m)) for cloud_m in gone]
    nearest_m = min(gaps_m, default=np.inf)
    # Of a tall object only one end may be seen in the hand.
    if aside_m is not None and aside_m > OTHER_HELD_M:
        return nearest_m > SURELY_GONE_M
    if before.stands(after, here_m):
        return True
    others = (
        gap_m < NEAR_M and len(cloud_m) >= OTHER_PX and np.ptp(cloud_m, axis=0).max() < OTHER_M
        for gap_m, cloud_m in zip(gaps_m, gone, strict=True)
    )
    return nearest_m > GONE_M and any(others)


_HERE, _NEXT, _ALL = slice(None, -1), slice(1, None), slice(None)
_BESIDE = (
    ((_HERE, _ALL), (_NEXT, _ALL)),
    ((_ALL, _HERE), (_ALL, _NEXT)),
    ((_HERE, _HERE), (_NEXT, _NEXT)),
    ((_HERE, _NEXT), (_NEXT, _HERE)),
)
"""Slices of an image that pair every pixel with those below, to the right and across."""

FRONT_M = 0.4
"""The front is what was seen so near to the hand when it grasped the handle."""

SAME_M, SAME_DOOR_M = 0.055, 0.1
"""A drawer's front, and a fridge's, seen so near to where it was, along the camera's axis, is
closed: a drawer may stand 5 cm out, and the fridge's handle 9 cm."""

LEAST_SEEN, LEAST_VIEW = 20, 0.3
"""A front needs so many points, and such a share of them in view."""

MOST_CHANGED = 0.3
"""Of these, such a share may be gone or nearer. On 30 looks that were watched, closed fronts had
0.05 at most, and others 0.67 at least."""


AJAR_RAD = 0.2
"""A fridge that is seen with a smaller opening may be closed, which it is up to 0.15 rad."""


class Fronts:
    """The closed fronts of an episode's doors and drawers, in a frame that does not move."""

    def __init__(self) -> None:
        """Has seen nothing yet."""
        self._surfaces_m: dict[int, Array] = {}
        self._hands_m: dict[int, Array] = {}

    def see(self, number: int, points_m: Array) -> None:
        """Notes surfaces (P, 3) seen before the handle was grasped: till then it is closed."""
        if number not in self._hands_m:
            before_m = self._surfaces_m.get(number, np.zeros((0, 3)))
            self._surfaces_m[number] = np.concatenate((before_m, points_m))

    def touch(self, number: int, hand_m: Array) -> None:
        """Notes where the hand (3,) first grasped its handle."""
        self._hands_m.setdefault(number, hand_m)

    def keep(self, number: int, moved: Callable[[Array], NDArray[np.bool_]]) -> None:
        """Keeps what is not there when a door or drawer is open, without the wall beside it.

        Args:
            number: Its number.
            moved: Whether points (P, 3) are not there.
        """
        points_m = self.of(number)
        self._surfaces_m[number] = points_m[moved(points_m)]

    def of(self, number: int) -> Array:
        """Returns the points (P, 3) of a closed front, if it was seen and its handle grasped."""
        if number not in self._surfaces_m or number not in self._hands_m:
            return np.zeros((0, 3))
        points_m = self._surfaces_m[number]
        points_m = points_m[np.linalg.norm(points_m - self._hands_m[number], axis=1) < FRONT_M]
        return points_m if len(points_m) >= LEAST_SEEN else np.zeros((0, 3))


def is_there(look: Look, front_m: Array, *, hinged: bool = False) -> bool | None:
    """Returns whether a front (P, 3), in the base frame, is seen in a look; `hinged`: a fridge's.

    Returns:
        None if too little of it is in view.
    """
    _, gaps_m = look.behind_m(front_m)
    if len(gaps_m) < max(LEAST_SEEN, LEAST_VIEW * len(front_m)):
        return None
    same_m = SAME_DOOR_M if hinged else SAME_M
    return bool((np.abs(gaps_m) > same_m).mean() <= MOST_CHANGED)


def find_door(look: Look, inside_m: Array, known: Found | None) -> Found | None:
    """Returns the fridge around a place (3,), in the base frame, with its door as it is seen.

    Args:
        look: The look.
        inside_m: The place.
        known: The fridge as it was seen best so far. It stays unless it is seen better.
    """
    world_from_base = invert_pose(look.base_from_world)
    place_m = world_from_base[:3, :3] @ inside_m + world_from_base[:3, 3]
    images = Images.of([look.view], [look.own])
    found = find_fridge(images, place_m, world_from_base[:2, 3], opened=True)
    if known is None or (found is not None and found.score > known.score):
        return found
    joint = seen_joint(images, known, around_rad=MOST_RAD)
    return known if joint is None else replace(known, pose=np.append(known.pose[:3], joint))


def seen_through(look: Look, front_m: Array) -> NDArray[np.bool_]:
    """Whether a look sees through points of a front (P, 3), in the base frame.

    A point with something before it may still be there: an open drawer hides the one below.
    """
    which, gaps_m = look.behind_m(front_m)
    found = np.zeros(len(front_m), dtype=bool)
    found[which] = gaps_m > SAME_M
    return found
