"""Likely goal poses of Navigate: what can be inferred of a goal from what can be observed.

A goal is a start pose of another skill (`NavigateStarts`). Which skill and which pose is not
observed, but the point that the skill is about is, and whether a door or drawer is open can be
seen.
"""

from __future__ import annotations

import numpy as np

from hab_tasks.articulations import DRAWER, FRIDGE, ArticulationKind, Rectangle
from hab_tasks.engine.ground_truth import GroundTruth
from hab_tasks.episodes.robot_start import StartNoise
from hab_tasks.episodes.schema import Episode
from hab_tasks.navigation import NavigationMap, apart, covering, poses_reaching
from hab_tasks.privileged import Array
from hab_tasks.receptacles import CONTAINERS

NEAREST_M = 0.65
"""Minimum distance of a guess to an object; starts with the hand at the object are rejected."""

CELL_M = 0.05
"""Spacing of the poses in a spawn region."""

OPEN_SHARE = 0.1
"""A door or drawer opened farther is there to be closed, or to be reached into."""


def goal_guesses(
    episode: Episode, truth: GroundTruth, map_: NavigationMap, point_m: Array
) -> Array:
    """Returns likely goal poses of an episode, the first to be tried first, (G, 3).

    For an object in a drawer they are in a spawn region of the drawer. An object in the open fridge
    may have to be reached, or the door to be closed. Other objects are reached from the nearest
    free floor.

    Args:
        episode: The episode.
        truth: The true state.
        map_: The map.
        point_m: (3,) the point to go to.
    """
    target = episode.targets[0]
    receptacle = target.start or target.goal
    container = None if receptacle is None else CONTAINERS.get(receptacle[0])
    nearest = apart(poses_reaching(map_, point_m, NEAREST_M, StartNoise().farthest_m))
    found = nearest
    if container is not None and episode.held is None:
        kind = DRAWER if container == DRAWER.name else FRIDGE
        region = covering(_region_poses(kind, truth, map_))
        is_open = _is_open(kind, truth)
        found = np.vstack((region, nearest)) if kind is FRIDGE and is_open else region
    if len(found):
        return found
    # The map has no room at the point, where the free floor is measured otherwise.
    x, y = map_.nearest_free(point_m[:2])
    return np.array([(x, y, np.arctan2(point_m[1] - y, point_m[0] - x))])


def _is_open(kind: ArticulationKind, truth: GroundTruth) -> bool:
    state = truth.articulation(kind)
    lower, upper = state.limits
    return state.joint - lower > OPEN_SHARE * (upper - lower)


def _region_poses(kind: ArticulationKind, truth: GroundTruth, map_: NavigationMap) -> Array:
    """Returns the poses on free floor in a spawn region, facing the handle, (K, 3)."""
    region: Rectangle = kind.closing_region if _is_open(kind, truth) else kind.opening_region
    ahead, aside = (np.arange(low, high, CELL_M) for low, high in (region.x_m, region.y_m))
    local = np.stack(np.meshgrid(ahead, aside), axis=-1).reshape(-1, 2)
    x, y, yaw = truth.spawn_frame(kind)
    cosine, sine = np.cos(yaw), np.sin(yaw)
    places = local @ np.array(((cosine, sine), (-sine, cosine))) + np.array((x, y))
    places = places[map_.is_free(places)]
    gap_m = truth.articulation(kind).handle_m[:2] - places
    return np.column_stack((places, np.arctan2(gap_m[:, 1], gap_m[:, 0])))
