"""Placement of the human-render camera: beside the robot, with a clear view of the hand."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import sapien
from mani_skill.utils.sapien_utils import look_at

from hab_tasks.engine.episode_simulation import EpisodeSimulation
from hab_tasks.geometry import apply, planar
from hab_tasks.privileged import Array

Hit = tuple[float, str]
"""Distance [m] of a ray's hit, and the name of the body."""

CastRay = Callable[[Array, Array, float], Hit | None]
"""(origin (3,), unit direction (3,), length [m]) -> the first hit, or None."""

LOOK_AT_M = (0.7, 0.0, 0.75)
CANDIDATES_M = (
    (-1.4, 1.1, 2.1),
    (-1.4, -1.1, 2.1),
    (-0.5, 1.7, 2.1),
    (-0.5, -1.7, 2.1),
    (0.9, 1.7, 2.1),
    (0.9, -1.7, 2.1),
    (-0.9, 0.8, 2.1),
    (-0.9, -0.8, 2.1),
    (-0.2, 1.2, 2.1),
    (-0.2, -1.2, 2.1),
    (-0.45, 0.35, 2.1),
    (-0.45, -0.35, 2.1),
    (0.2, 0.9, 1.5),
    (0.2, -0.9, 1.5),
    (0.1, 0.3, 2.3),
    (0.1, -0.3, 2.3),
    (0.0, 0.6, 0.9),
    (0.0, -0.6, 0.9),
    (0.3, 0.3, 0.75),
    (0.3, -0.3, 0.75),
)
"""Camera positions in the base frame, best first; the last ones look over the shoulder, down from
above, and into the furniture ahead of the robot."""

FIELD_OF_VIEW_RAD = 1.2

_MARGIN_M = 0.15
"""Clearance behind the camera."""

_SKIN_M = 0.02
_HAND = ("gripper", "wrist")
"""Substrings of the names of the hand's links, which do not count as occluding it."""


def _pose(candidate: int) -> sapien.Pose:
    return look_at(CANDIDATES_M[candidate], LOOK_AT_M).sp


FIRST_VIEW = _pose(0)


class Viewpoint:
    """Chooses the camera position; it moves with the base until the hand is occluded."""

    def __init__(self) -> None:
        self._episode, self._chosen = "", 0

    def follow(self, world: EpisodeSimulation, cast: CastRay) -> sapien.Pose | None:
        """Returns the camera's new pose in the base frame; None to keep the current one.

        Args:
            world: The simulation.
            cast: Casts a ray against all bodies, open doors included.
        """
        snapshot = world.snapshot
        base = np.asarray(snapshot.base[0], dtype=float)
        hand_m = np.asarray(snapshot.ee_m[0], dtype=float)
        name = world.held_name()
        new = world.episode.id != self._episode
        if not new and _sees(self._chosen, base, hand_m, name, cast):
            return None
        self._episode = world.episode.id
        seeing = (i for i in range(len(CANDIDATES_M)) if _sees(i, base, hand_m, name, cast))
        found = next(seeing, None)
        if found is None:  # the first candidate outside walls, else the current one
            found = next(
                (i for i in range(len(CANDIDATES_M)) if _stands_free(i, base, cast)), self._chosen
            )
        if found == self._chosen and not new:
            return None
        self._chosen = found
        return _pose(found)


def in_world(candidate: int, base: Array) -> Array:
    """Returns a candidate's position (3,) in the world.

    Args:
        candidate: Index in `CANDIDATES_M`.
        base: (3,) x [m], y [m], yaw [rad].
    """
    return _to_world(np.array(CANDIDATES_M[candidate]), base)


def _sees(candidate: int, base: Array, hand_m: Array, held: str | None, cast: CastRay) -> bool:
    """Returns whether the hand is in view and not occluded."""
    camera_m = in_world(candidate, base)
    ahead = _unit(_to_world(np.array(LOOK_AT_M), base) - camera_m)
    way_m = hand_m - camera_m
    distance_m = float(np.linalg.norm(way_m))
    in_picture = float(ahead @ way_m) > distance_m * np.cos(0.45 * FIELD_OF_VIEW_RAD)
    if not in_picture or not _stands_free(candidate, base, cast):
        return False
    hit = cast(camera_m, way_m / distance_m, distance_m)
    return hit is None or hit[0] > distance_m - _SKIN_M or _is_hand(hit[1], held)


def _stands_free(candidate: int, base: Array, cast: CastRay) -> bool:
    """Returns whether the path from the robot's head to just behind the camera is free."""
    camera_m = in_world(candidate, base)
    height_m = max(1.3, float(camera_m[2]))  # above the robot's head, which is 1.1 m high
    above_m = np.array((*base[:2], height_m))
    over_m = np.array((*camera_m[:2], height_m))
    for start_m, end_m in ((above_m, over_m), (over_m, camera_m)):
        way_m = end_m - start_m
        length_m = float(np.linalg.norm(way_m))
        if length_m > 0 and cast(start_m, way_m / length_m, length_m + _MARGIN_M) is not None:
            return False
    return True


def _is_hand(name: str, held: str | None) -> bool:
    return name == held or any(part in name for part in _HAND)


def _to_world(point_m: Array, base: Array) -> Array:
    return apply(planar(*base.tolist()), point_m)


def _unit(vector: Array) -> Array:
    return vector / np.linalg.norm(vector)
