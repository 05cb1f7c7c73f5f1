"""What a plan's actions are to the robot: a skill, the places it can be done from, its effect."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from hab_planner.plan import Action
from hab_planner.problem import NAMES, Atom, atoms_of

from hab_spa.motion.robot import Motion, Robot
from hab_spa.scenes.scene import Scene
from hab_spa.shapes import Array
from hab_spa.skills.drawer import close_drawer, drawer_places, drawer_ways, open_drawer
from hab_spa.skills.fridge import close_fridge, fridge_places, fridge_ways, open_fridge
from hab_spa.skills.pick import pick, pick_ways
from hab_spa.skills.place import place, place_ways
from hab_tasks.constants import PLACE_RADIUS_M
from hab_tasks.navigation import NavigationMap, poses_reaching
from hab_tasks.tasks.base import Condition, Task

NEAREST_M, FARTHEST_M = 0.4, 1.35
"""Distance on the floor from the base to what is taken, or let go, by the stretched arm."""


Ways = Callable[[Array, int], float]
"""(base pose (3,), effort) -> how many ways to do something from there are found."""


@dataclass(frozen=True, kw_only=True)
class Interaction:
    """An action of a plan, other than to navigate.

    Attributes:
        action: The action.
        effect: What holds when it worked out.
        skill: (robot) -> it being done.
        places: (robot, map) -> base poses (K, 3) from which it may be possible, best first.
        point_m: (robot) -> what is to be reached (3,).
        ways: (robot, map) -> what tells for a base pose (3,), and effort, how many ways to do it
            from there are found.
    """

    action: Action
    effect: Condition
    skill: Callable[[Robot], Motion]
    places: Callable[[Robot, NavigationMap], Array]
    point_m: Callable[[Robot], Array]
    ways: Callable[[Robot, NavigationMap], Ways]


@dataclass(frozen=True, kw_only=True)
class Hands:
    """How a robot takes and puts down things: (robot, number of the object) -> it being done."""

    pick: Callable[[Robot, int], Motion] = pick
    place: Callable[[Robot, int], Motion] = place


def interaction(task: Task, action: Action, hands: Hands) -> Interaction:
    """Returns what an action of a task's plan is, for a robot with these hands."""
    thing = action.things[0]
    if action.name in ("open", "close"):
        fronts = [kind.name for kind in task.fronts]
        return _front(thing, fronts.index(thing), action)
    number = NAMES[task.name].items.index(thing)
    if action.name == "pick":
        return Interaction(
            action=action,
            effect=Condition(held=(number,)),
            skill=lambda robot: hands.pick(robot, number),
            places=lambda robot, map_: _around(map_, robot.scene.object_m(number)),
            point_m=lambda robot: robot.scene.object_m(number),
            ways=lambda robot, _map: partial(pick_ways, robot, number),
        )
    return Interaction(
        action=action,
        effect=Condition(placed=(number,)),
        skill=lambda robot: hands.place(robot, number),
        places=lambda robot, map_: _around(map_, robot.scene.goal_m(number)),
        point_m=lambda robot: robot.scene.goal_m(number),
        ways=lambda robot, _map: partial(place_ways, robot, number),
    )


def _around(map_: NavigationMap, point_m: Array) -> Array:
    """Returns base poses (K, 3) from which the stretched arm may come to a point, nearest first."""
    return poses_reaching(map_, point_m, NEAREST_M, FARTHEST_M)


def _front(kind: str, number: int, action: Action) -> Interaction:
    """Returns what it is to open or close a door or drawer."""
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
        places=lambda robot, map_: (
            drawer_places(robot, number, map_)
            if drawer
            else fridge_places(robot, number, map_, out)
        ),
        point_m=lambda robot: robot.scene.front(number).handle_m,
        ways=lambda robot, map_: _front_ways(robot, number, drawer, out, map_),
    )


def _front_ways(robot: Robot, number: int, drawer: bool, out: bool, map_: NavigationMap) -> Ways:
    if drawer:
        return lambda base, _effort: drawer_ways(robot, number, base, out)
    ways = fridge_ways(robot, number, map_, out)
    return lambda base, _effort: ways(base)


def believed(task: Task, scene: Scene) -> frozenset[Atom]:
    """Returns what is held, where it belongs, open and closed, as far as the robot knows."""
    objects = range(task.objects)
    held = tuple(k for k in objects if scene.holds(k))
    placed = tuple(k for k in objects if k not in held and _at_goal(scene, k))
    opened, closed = [], []
    for number, kind in enumerate(task.fronts):
        front = scene.front(number)
        lower, upper = front.limits
        joint, share = np.array(front.joint), np.array((front.joint - lower) / (upper - lower))
        opened += [number] * bool(kind.is_open(joint, share))
        closed += [number] * bool(kind.is_closed(joint))
    condition = Condition(held=held, placed=placed, opened=tuple(opened), closed=tuple(closed))
    return atoms_of(task, condition)


def _at_goal(scene: Scene, number: int) -> bool:
    return bool(np.linalg.norm(scene.object_m(number) - scene.goal_m(number)) < PLACE_RADIUS_M)
