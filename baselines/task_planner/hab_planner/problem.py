"""A task as a planning problem: what holds at the start and what has to hold in the end (S H.1)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from hab_planner.errors import PlannerError

if TYPE_CHECKING:
    from hab_tasks.tasks.base import Condition, Task

DOMAIN = Path(__file__).parent / "domain.pddl"

Atom = tuple[str, ...]
"""A ground predicate: its name, then the things it is about."""

ROOM, SPAWN = "room", "spawn"


@dataclass(frozen=True, kw_only=True)
class TaskProblem:
    """Things, what holds at the start, and what has to hold in the end.

    Attributes:
        name: The task's.
        things: Type -> names.
        start: What holds; everything else does not.
        goal: What has to hold.
    """

    name: str
    things: dict[str, tuple[str, ...]]
    start: frozenset[Atom]
    goal: frozenset[Atom]

    def pddl(self) -> str:
        """Returns the problem as a PDDL file for `DOMAIN`."""
        things = "\n".join(
            f"    {' '.join(names)} - {k}" for k, names in self.things.items() if names
        )
        start, goal = (
            "\n".join(f"    ({' '.join(atom)})" for atom in sorted(atoms))
            for atoms in (self.start, self.goal)
        )
        return (
            f"(define (problem {self.name})\n  (:domain home-assistant)\n"
            f"  (:objects\n{things})\n  (:init\n{start})\n  (:goal (and\n{goal})))\n"
        )

    def started(self, atoms: frozenset[Atom]) -> TaskProblem:
        """Returns the same problem from another start, to plan anew after a failure."""
        return replace(self, start=atoms)


@dataclass(frozen=True, kw_only=True)
class Names:
    """What a task's things are called in its problem, by their numbers in the task.

    Attributes:
        items: The objects.
        within: Object -> the door or drawer that it starts behind.
        inside: Object -> the object whose goal its own goal is in.
        open: Whether doors and drawers start open.
    """

    items: tuple[str, ...]
    within: dict[int, int]
    inside: dict[int, int]
    open: bool = False


NAMES: dict[str, Names] = {
    "tidy_house": Names(items=tuple(f"object-{n + 1}" for n in range(5)), within={}, inside={}),
    "prepare_groceries": Names(
        items=("from-fridge-1", "from-fridge-2", "to-fridge"),
        within={},
        inside={},
        open=True,
    ),
    "set_table": Names(items=("bowl", "apple"), within={0: 0, 1: 1}, inside={1: 0}),
}
"""Task -> its names, and the containment that S H.1 lists for it."""


def tasks() -> dict[str, Task]:
    """Returns env id -> task, of every environment that is one."""
    from hab_tasks.envs import ENVS  # loads the simulator, which --help does not need
    from hab_tasks.tasks.task_env import TaskEnv

    return {e.id: e.env.task for e in ENVS.values() if issubclass(e.env, TaskEnv)}


def task_of(env_id: str) -> Task:
    """Returns the task of an environment.

    Raises:
        PlannerError: Not the id of a task.
    """
    known = tasks()
    if env_id not in known:
        raise PlannerError(f"{env_id!r} is no task to plan; there are {', '.join(known)}.")
    return known[env_id]


@cache
def problem_of(env_id: str) -> TaskProblem:
    """Returns the problem of a task: S H.1's start, and the goal that its success asks for.

    Raises:
        PlannerError: Not the id of a task.
    """
    task = task_of(env_id)
    names = NAMES[task.name]
    fronts = tuple(kind.name for kind in task.fronts)
    goals = tuple(f"{item}-goal" for item in names.items)
    start: set[Atom] = {("at-robot", SPAWN), ("hand-empty",), ("is-open", ROOM)}
    for number, (item, goal) in enumerate(zip(names.items, goals, strict=True)):
        behind = names.within.get(number)
        start.add(("in", item, ROOM if behind is None else fronts[behind]))
        other = names.inside.get(number)
        start.add(("free-standing", goal) if other is None else ("inside", goal, goals[other]))
    for front in fronts:
        start |= {("articulated", front), ("is-open" if names.open else "is-closed", front)}
    return TaskProblem(
        name=task.name.replace("_", "-"),
        things={
            "item": names.items,
            "goal": goals,
            "container": (*fronts, ROOM),
            "pose": (SPAWN,),
        },
        start=frozenset(start),
        goal=atoms_of(task, task.goal),
    )


def atoms_of(task: Task, condition: Condition) -> frozenset[Atom]:
    """Returns what a condition of a task, as a stage or its success, says in predicates."""
    items = NAMES[task.name].items
    fronts = [kind.name for kind in task.fronts]
    return frozenset(
        (
            *(("holding", items[k]) for k in condition.held),
            *(("at", items[k], f"{items[k]}-goal") for k in condition.placed),
            *(("is-open", fronts[j]) for j in condition.opened),
            *(("is-closed", fronts[j]) for j in condition.closed),
        )
    )
