"""Plan actions as interactions: skill, candidate base poses and effect."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from hab_plans.plan import Action
from hab_plans.problem import Atom, atoms_of, things

from hab_spa.motion.robot import Motion, Robot
from hab_spa.scenes.scene import Scene
from hab_spa.shapes import Array
from hab_spa.skills.drawer import close_drawer, drawer_base_poses, drawer_score, open_drawer
from hab_spa.skills.fridge.skill import close_fridge, fridge_base_poses, fridge_score, open_fridge
from hab_spa.skills.pick import pick, pick_score
from hab_spa.skills.place import place, place_score
from hab_tasks.constants import PLACE_RADIUS_M
from hab_tasks.navigation import NavigationMap, poses_reaching
from hab_tasks.tasks.base import Condition, Task

NEAREST_M, FARTHEST_M = 0.4, 1.35
"""Horizontal distance from the base at which the arm can pick or place."""


Score = Callable[[Array, int], float]
"""(base pose (3,), effort) -> number of solutions found from there; 0 if the pose is useless."""


@dataclass(frozen=True, kw_only=True)
class Interaction:
    """An action of a plan, other than navigation.

    Attributes:
        action: The action.
        effect: Condition that holds after success.
        skill: (robot) -> motion of the skill.
        base_poses: (robot, map) -> candidate base poses (K, 3), best first.
        point_m: (robot) -> point to reach (3,).
        score: (robot, map) -> scoring function of base poses.
    """

    action: Action
    effect: Condition
    skill: Callable[[Robot], Motion]
    base_poses: Callable[[Robot, NavigationMap], Array]
    point_m: Callable[[Robot], Array]
    score: Callable[[Robot, NavigationMap], Score]


@dataclass(frozen=True, kw_only=True)
class Hands:
    """Pick and place skills: (robot, number of the object) -> motion."""

    pick: Callable[[Robot, int], Motion] = pick
    place: Callable[[Robot, int], Motion] = place


def interaction(task: Task, action: Action, hands: Hands) -> Interaction:
    """Returns the interaction of a plan's action, for a robot with these skills."""
    thing = action.things[0]
    if action.name in ("open", "close"):
        articulations = [kind.name for kind in task.articulations]
        return _articulation(thing, articulations.index(thing), action)
    number = things(task.spec).index(thing)
    if action.name == "pick":
        return Interaction(
            action=action,
            effect=Condition(held=(number,)),
            skill=lambda robot: hands.pick(robot, number),
            base_poses=lambda robot, map_: _around(map_, robot.scene.object_m(number)),
            point_m=lambda robot: robot.scene.object_m(number),
            score=lambda robot, _map: partial(pick_score, robot, number),
        )
    return Interaction(
        action=action,
        effect=Condition(placed=(number,)),
        skill=lambda robot: hands.place(robot, number),
        base_poses=lambda robot, map_: _around(map_, robot.scene.goal_m(number)),
        point_m=lambda robot: robot.scene.goal_m(number),
        score=lambda robot, _map: partial(place_score, robot, number),
    )


def _around(map_: NavigationMap, point_m: Array) -> Array:
    """Returns base poses (K, 3) from which the arm may reach a point, nearest first."""
    return poses_reaching(map_, point_m, NEAREST_M, FARTHEST_M)


def _articulation(kind: str, number: int, action: Action) -> Interaction:
    """Returns the interaction that opens or closes a door or drawer."""
    out = action.name == "open"
    skills = {
        ("drawer", True): open_drawer,
        ("drawer", False): close_drawer,
        ("fridge", True): open_fridge,
        ("fridge", False): close_fridge,
    }
    drawer = kind == "drawer"
    return Interaction(
        action=action,
        effect=Condition(opened=(number,)) if out else Condition(closed=(number,)),
        skill=partial(skills[kind, out], number=number),
        base_poses=lambda robot, map_: (
            drawer_base_poses(robot, number, map_)
            if drawer
            else fridge_base_poses(robot, number, map_, out)
        ),
        point_m=lambda robot: robot.scene.articulation(number).handle_m,
        score=lambda robot, map_: _front_score(robot, number, drawer, out, map_),
    )


def _front_score(robot: Robot, number: int, drawer: bool, out: bool, map_: NavigationMap) -> Score:
    if drawer:
        return lambda base, _effort: drawer_score(robot, number, base, out)
    score = fridge_score(robot, number, map_, out)
    return lambda base, _effort: score(base)


def believed(task: Task, scene: Scene) -> frozenset[Atom]:
    """Returns the atoms that the robot believes to hold: held, placed, open and closed."""
    objects = range(task.objects)
    held = tuple(k for k in objects if scene.holds(k))
    placed = tuple(k for k in objects if k not in held and _at_goal(scene, k))
    opened, closed = [], []
    for number, kind in enumerate(task.articulations):
        articulation = scene.articulation(number)
        lower, upper = articulation.limits
        joint, share = (
            np.array(articulation.joint),
            np.array((articulation.joint - lower) / (upper - lower)),
        )
        opened += [number] * bool(kind.is_open(joint, share))
        closed += [number] * bool(kind.is_closed(joint))
    condition = Condition(held=held, placed=placed, opened=tuple(opened), closed=tuple(closed))
    return atoms_of(task.spec, condition)


def _at_goal(scene: Scene, number: int) -> bool:
    return bool(np.linalg.norm(scene.object_m(number) - scene.goal_m(number)) < PLACE_RADIUS_M)
