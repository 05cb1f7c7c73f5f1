"""Scripted experts: the actions of skills' environments that imitation learns from.

Each is a function of a skill's environment, of which it knows all. Its action depends on the
current state alone, so that it can label the states that another policy visits. In a vector
environment, ``env.call("ask", "hab_experts:pick_action")`` returns the actions of all rows.
"""

from __future__ import annotations

import math
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from hab_experts.cavity import Cavity
from hab_experts.door import door_motion
from hab_experts.drawer import drawer_motion
from hab_experts.follower import ShortestPathFollower
from hab_experts.pick import pick_motion
from hab_experts.place import place_motion
from hab_tasks.arrays import norm
from hab_tasks.articulations import FRIDGE
from hab_tasks.engine.episode_simulation import EpisodeSimulation
from hab_tasks.engine.goals import frame_of
from hab_tasks.engine.skill_env import SkillEnv
from hab_tasks.episodes import Episode
from hab_tasks.episodes.schema import ReceptacleRef
from hab_tasks.geometry import to_matrix
from hab_tasks.receptacles import CABINET, CONTAINERS, SHELVES

SKILLS = {
    "pick_action": ("pick",),
    "place_action": ("place",),
    "drawer_action": ("open_drawer", "close_drawer"),
    "door_action": ("open_fridge", "close_fridge"),
    "shortest_path_action": ("navigate",),
}
"""Expert -> the skills that it masters."""

FRIDGE_OUTSIDE_M = 0.42
"""See `Cavity.outside_m`, from the fridge's root."""

FRIDGE_BOARD_M = 1.16
"""A hand below this height is not on the fridge's board."""

SHELF_OUTSIDE_M = 0.2
"""The same distance, from the edge of a shelf."""

_followers: WeakKeyDictionary[SkillEnv, tuple[Episode, ShortestPathFollower]] = WeakKeyDictionary()
"""Environment -> its episode and the follower of that."""


def pick_action(env: SkillEnv) -> NDArray[np.float32]:
    """Returns the ``ee`` action of an expert that knows all objects, (1, 4).

    It picks the target by feedback (`hab_experts.pick`).
    """
    simulation = env.simulation
    target = simulation.episode.targets[0]
    action = pick_motion(
        simulation.snapshot,
        holds=simulation.held_name() == target.object,
        nearest=_nearest_object(simulation) == target.object,
        cavity=cavity_around(simulation, target.start),
    )
    return action.astype(np.float32)[None]


def place_action(env: SkillEnv) -> NDArray[np.float32]:
    """Returns the ``ee`` action of an expert that knows the object's place, (1, 4).

    It places the object by feedback (`hab_experts.place`).
    """
    simulation = env.simulation
    target = simulation.episode.targets[0]
    action = place_motion(
        simulation.snapshot,
        np.array(simulation.goals.goals_m[0, 0].tolist()),
        holds=simulation.held_name() == target.object,
        cavity=cavity_around(simulation, target.goal),
    )
    return action.astype(np.float32)[None]


def drawer_action(env: SkillEnv) -> NDArray[np.float32]:
    """Returns the ``ee`` action of an expert that knows the drawer's axis, (1, 4).

    It opens or closes the drawer by feedback (`hab_experts.drawer`).
    """
    (drawer,) = env.simulation.articulations()
    action = drawer_motion(env.simulation.snapshot, drawer, opens=_opens(env))
    return action.astype(np.float32)[None]


def door_action(env: SkillEnv) -> NDArray[np.float32]:
    """Returns the ``ee_base`` action of an expert that knows the door's axis, (1, 6).

    It opens or closes the fridge's door by feedback (`hab_experts.door`).
    """
    (door,) = env.simulation.articulations()
    action = door_motion(env.simulation.snapshot, door, opens=_opens(env))
    return action.astype(np.float32)[None]


def shortest_path_action(env: SkillEnv, repeat: int = 1) -> NDArray[np.int64]:
    """Returns the ``base_discrete`` action of an expert that knows the map and the goal, (1,).

    It follows the shortest path from the current base pose (`ShortestPathFollower`), as Habitat's
    follower does for imitation learning.

    Args:
        env: Navigate.
        repeat: Number of steps for which each action is executed; the same in an episode.
    """
    base = env.simulation.snapshot.base[0].astype(float)
    return np.array([_follower(env, repeat).action(base)], dtype=np.int64)


def _follower(env: SkillEnv, repeat: int) -> ShortestPathFollower:
    """Returns the follower of the current episode."""
    found, episode = _followers.get(env), env.simulation.episode
    if found is None or found[0] is not episode:
        assert episode.navigation is not None
        map_ = env.simulation.maps.of(episode.scene_id, episode.joints)
        goal = np.array(episode.navigation.base)
        follower = ShortestPathFollower(map_, goal, repeat * env.robot.base_step_rad)
        _followers[env] = found = episode, follower
    return found[1]


def cavity_around(simulation: EpisodeSimulation, receptacle: ReceptacleRef | None) -> Cavity | None:
    """Returns the fridge or shelf of a receptacle; None if it is an open surface."""
    if receptacle is None:
        return None
    if CONTAINERS.get(receptacle[0]) == FRIDGE.name:
        handle = next(h for h in simulation.grasp.handles if h.name == FRIDGE.marker)
        return Cavity(
            frame=np.array(frame_of(handle)), outside_m=FRIDGE_OUTSIDE_M, lowest_m=FRIDGE_BOARD_M
        )
    if receptacle[0] in (*CABINET, *SHELVES):
        return _shelf(simulation, receptacle)
    return None


def _shelf(simulation: EpisodeSimulation, receptacle: ReceptacleRef) -> Cavity:
    """Returns a shelf, which opens to the side of the robot."""
    spec = simulation.source.scene(simulation.episode.scene_id)
    box = next(one for one in spec.receptacles if (one.name, one.body) == receptacle)
    body = next(one for one in spec.objects if one.name == box.body)
    world_from_box = to_matrix(body.world_from_object) @ to_matrix(box.body_from_box)
    _, across, deep = sorted(range(3), key=lambda axis: -abs(box.up[axis]))
    if box.half_size_m[across] < box.half_size_m[deep]:
        across, deep = deep, across
    center_m, out = world_from_box[:3, 3], world_from_box[:3, deep]
    if out @ (simulation.snapshot.ee_m[0] - center_m) < 0:
        out = -out
    return Cavity(
        frame=np.array((center_m[0], center_m[1], math.atan2(out[1], out[0]))),
        outside_m=box.half_size_m[deep] + SHELF_OUTSIDE_M,
        half_width_m=box.half_size_m[across],
    )


def _nearest_object(simulation: EpisodeSimulation) -> str:
    """Returns the name of the movable object whose centre of mass is nearest to the hand."""
    gaps_m = simulation.grasp.objects_com_m() - simulation.grasp.ee_position_m()
    return list(simulation.scene_bodies.movable)[int(norm(gaps_m).argmin())]


def _opens(env: SkillEnv) -> bool:
    return env.skill.name.startswith("open")
