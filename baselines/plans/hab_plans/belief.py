"""Atoms of the planning domain: what a robot believes, and what the simulator says.

The simulator's are read by the functions that define a task's success.
"""

from __future__ import annotations

from typing import Literal, Protocol

import numpy as np

from hab_plans.problem import ROOM, Atom, atoms_of, goal_container, problem_of, things
from hab_plans.stage import Stage
from hab_tasks.articulations import ArticulationKind
from hab_tasks.constants import PLACE_RADIUS_M
from hab_tasks.privileged import Array, ArticulationState
from hab_tasks.tasks.base import Condition, Task
from hab_tasks.tasks.task_env import TaskEnv

Opening = Literal["open", "closed", "ajar"]
"""What stands ajar is neither open nor closed, so that a goal to close it remains to be done."""


class Scene(Protocol):
    """Beliefs about the objects, doors and drawers of an episode, by number.

    Attributes:
        place_error_m: How far off the place of an object may be.
    """

    place_error_m: float

    @property
    def holding(self) -> bool:
        """Whether the hand holds an object."""
        ...

    def holds(self, number: int) -> bool:
        """Whether the hand is believed to hold this object of the episode."""
        ...

    def object_m(self, number: int) -> Array:
        """Returns the believed centre of mass (3,) of an object."""
        ...

    def goal_m(self, number: int) -> Array:
        """Returns the goal (3,) of its centre of mass."""
        ...

    def was_let_go(self, number: int) -> bool:
        """Whether an object lies where the hand let it go, no longer where it started."""
        ...

    def articulation(self, number: int) -> ArticulationState:
        """Returns a door or drawer of the episode."""
        ...

    def opening(self, number: int, kind: ArticulationKind) -> Opening:
        """Returns whether a door or drawer of a kind is open."""
        ...


def point_of(scene: Scene, stage: Stage) -> Array:
    """Returns the point (3,) that the hand has to reach in a stage: an object, goal or handle."""
    if stage.articulation is not None:
        return scene.articulation(stage.articulation).handle_m
    # A place is about where the object goes, wherever in the hand it is.
    return scene.object_m(stage.object) if stage.skill == "pick" else scene.goal_m(stage.object)


def achieved(task: Task, stage: Stage, scene: Scene) -> bool:
    """Returns whether a stage's effect holds, as far as a scene knows."""
    return atoms_of(task.spec, stage.effect) <= believed(task, scene)


def believed(task: Task, scene: Scene) -> frozenset[Atom]:
    """Returns the atoms that the robot believes to hold: held, placed, open and closed."""
    objects = range(task.objects)
    held = tuple(k for k in objects if scene.holds(k))
    # As in the success of a task: what is carried over its goal has not been placed.
    placed = tuple(k for k in objects if k not in held and _at_goal(scene, k))
    opened, closed = [], []
    for number, kind in enumerate(task.articulations):
        opening = scene.opening(number, kind)
        opened += [number] * (opening == "open")
        closed += [number] * (opening == "closed")
    condition = Condition(held=held, placed=placed, opened=tuple(opened), closed=tuple(closed))
    let_go = (k for k in objects if k not in held and scene.was_let_go(k))
    # Beside its goal, in the same container: that is where it was carried.
    lies = {("in", things(task.spec)[k], goal_container(task.spec, k)) for k in let_go}
    return atoms_of(task.spec, condition) | lies


def known_opening(scene: Scene, number: int, kind: ArticulationKind) -> Opening:
    """Returns whether a door or drawer is open; `Scene.opening` where its state is known."""
    articulation = scene.articulation(number)
    lower, upper = articulation.limits
    joint = np.array(articulation.joint, dtype=np.float32)
    share = np.array((articulation.joint - lower) / (upper - lower), dtype=np.float32)
    if kind.is_open(joint, share):
        return "open"
    return "closed" if kind.is_closed(joint) else "ajar"


def _at_goal(scene: Scene, number: int) -> bool:
    gap_m = float(np.linalg.norm(scene.object_m(number) - scene.goal_m(number)))
    return gap_m < PLACE_RADIUS_M - scene.place_error_m


def observed(env: TaskEnv, row: int = 0) -> frozenset[Atom]:
    """Returns the current atoms: held, placed, open and closed.

    A partly open door is neither open nor closed.

    Args:
        env: A task's environment, unwrapped.
        row: Batch row.
    """
    objects, articulations = range(env.task.objects), range(len(env.task.articulations))
    conditions = (
        *(Condition(held=(k,)) for k in objects),
        *(Condition(placed=(k,)) for k in objects),
        *(Condition(opened=(j,)) for j in articulations),
        *(Condition(closed=(j,)) for j in articulations),
    )
    true = [atoms_of(env.task.spec, c) for c in conditions if bool(env.holds(c)[row])]
    return frozenset().union(*true)


def start_from(env: TaskEnv, row: int = 0) -> frozenset[Atom]:
    """Returns the initial state for replanning: observed and static atoms.

    Args:
        env: A task's environment, unwrapped.
        row: Batch row.
    """
    return start_given(env.default_id(), observed(env, row))


def start_given(env_id: str, seen: frozenset[Atom]) -> frozenset[Atom]:
    """Returns a task's initial state in which these atoms hold: held, placed, open and closed.

    An object is in the container in which it started unless an atom says that it is in another.

    The robot is at no pose, so that the plan starts with navigation.

    Raises:
        PlannerError: Not the id of a task.
    """
    problem = problem_of(env_id)
    changing = {"at", "placed", "holding", "hand-empty", "is-open", "is-closed"}
    # The room is a container that is always open; doors and drawers are as seen.
    kept = {a for a in problem.start if a[0] not in changing or a == ("is-open", ROOM)}
    elsewhere = {atom[1] for atom in seen if atom[0] == "in"}
    kept = {a for a in kept if a[0] != "in" or a[1] not in elsewhere}
    # Conditions say only where an object is (`at`); the domain's `placed` follows.
    placed = {("placed", atom[1]) for atom in seen if atom[0] == "at"}
    empty = set() if any(atom[0] == "holding" for atom in seen) else {("hand-empty",)}
    return frozenset(kept | seen | placed | empty)
