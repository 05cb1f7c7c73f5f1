"""Planning problems of tasks: initial state, goal and actions (S H.1).

Other packages register a skill's PDDL action and provider here. Registering imports nothing; call
it on import of a module, beside `hab_tasks.register_skill`.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hab_tasks.errors import HabError
from hab_tasks.registration import TASKS, imported_id
from hab_tasks.task_spec import TaskSpec, behind

if TYPE_CHECKING:
    from hab_tasks.agent import AgentSetup
    from hab_tasks.tasks.base import Condition, Task


class PlannerError(HabError):
    """Not a task, or a plan that does not fit its problem."""


class NoPlanError(PlannerError):
    """The goal is provably unreachable from the initial state."""


DOMAIN = Path(__file__).parent / "domain.pddl"

ACTIONS: dict[str, str] = {}
"""Name of a registered action -> PDDL."""

ACTION_OF: dict[str, str] = {}
"""Skill of tasks -> the registered action that it carries out."""

PROVIDERS: dict[str, str] = {}
"""Skill of tasks -> ``module:factory`` of its provider."""

_ACTION = re.compile(r"\(:action\s+([\w-]+)")


def register_action(pddl: str, skill: str) -> None:
    """Adds an action to the planning domain (``domain.pddl``).

    Args:
        pddl: ``(:action open-x :parameters (?z - container) ...)``; its first parameter is what the
            skill is about.
        skill: Name of the skill in tasks, e.g. ``open_x``.

    Raises:
        PlannerError: Not one action, or another one has this name.
    """
    names = _ACTION.findall(pddl)
    if len(names) != 1 or ACTIONS.get(names[0], pddl) != pddl:
        raise PlannerError(f"Action of {skill}: one (:action NAME ...) with a new name is valid.")
    ACTIONS[names[0]], ACTION_OF[skill] = pddl, names[0]


def register_provider(skill: str, factory: str) -> None:
    """Makes agents that execute plans use a provider for a skill.

    Args:
        skill: Name of the skill in tasks.
        factory: ``module:factory``; called with the agent's `AgentSetup`, it returns a
            `SkillProvider`, or an `Agent` of the skill's environment.
    """
    PROVIDERS[skill] = factory


def load_factory(reference: str) -> Callable[[AgentSetup], Any]:
    """Returns the factory ``module:factory`` of a provider."""
    module, _, name = reference.partition(":")
    return getattr(importlib.import_module(module), name)


def domain() -> str:
    """Returns the planning domain in PDDL, with registered actions."""
    base = DOMAIN.read_text(encoding="utf-8").rstrip()
    return "\n\n".join((base.removesuffix(")"), *ACTIONS.values())) + ")\n" if ACTIONS else base


Atom = tuple[str, ...]
"""A ground atom: predicate, then arguments."""

ROOM, SPAWN = "room", "spawn"


@dataclass(frozen=True, kw_only=True)
class TaskProblem:
    """A STRIPS problem.

    Attributes:
        name: Name of the task.
        things: Type -> names of the objects.
        start: Initial state; all other atoms are false.
        goal: Atoms of the goal.
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
        """Returns the problem with another initial state, for replanning."""
        return replace(self, start=atoms)


def thing(name: str) -> str:
    """Returns the PDDL name of a target."""
    return name.replace("_", "-")


def things(spec: TaskSpec) -> tuple[str, ...]:
    """Returns the PDDL names of a task's targets, in order."""
    return tuple(thing(target.name) for target in spec.targets)


def goal_container(spec: TaskSpec, number: int) -> str:
    """Returns the container of a target's goal."""
    return behind(spec, spec.goal_of(spec.targets[number])) or ROOM


def spec_of(reference: str) -> TaskSpec:
    """Returns the declaration of a task.

    Args:
        reference: Environment id, ``X-v1`` or ``module:X-v1``.

    Raises:
        PlannerError: Not the id of a task.
        HabError: The module cannot be imported.
    """
    env_id = imported_id(reference) if ":" in reference else reference
    if env_id not in TASKS:
        raise PlannerError(f"{reference!r} is not a task. Valid: {', '.join(TASKS)}.")
    return TASKS[env_id]


def task_of(reference: str) -> Task:
    """Returns a compiled task; raises as `spec_of` does."""
    spec = spec_of(reference)
    from hab_tasks.tasks.base import compile_task  # loads the simulator

    return compile_task(spec)


@cache
def problem_of(reference: str) -> TaskProblem:
    """Returns the problem of a task: the initial state of S H.1, and the task's success as goal.

    Raises:
        PlannerError: Not the id of a task.
    """
    spec = spec_of(reference)
    items = things(spec)
    goals = {item: f"{item}-goal" for item in items}
    start: set[Atom] = {("at-robot", SPAWN), ("hand-empty",), ("is-open", ROOM)}
    for number, (item, target) in enumerate(zip(items, spec.targets, strict=True)):
        start.add(("in", item, behind(spec, target.start) or ROOM))
        start.add(("goal-in", goals[item], goal_container(spec, number)))
        if target.inside is None:
            start.add(("free-standing", goals[item]))
        else:
            # Its goal moves with that object, which therefore has to be there first.
            start.add(("inside", goals[item], goals[thing(target.inside)]))
    for name in spec.articulations:
        opened = name in spec.starts_open
        start |= {("articulated", name), ("is-open" if opened else "is-closed", name)}
    done = {("at", item, goal) for item, goal in goals.items()}
    return TaskProblem(
        name=spec.name.replace("_", "-"),
        things={
            "item": items,
            "goal": tuple(goals.values()),
            "container": (*spec.articulations, ROOM),
            "pose": (SPAWN,),
        },
        start=frozenset(start),
        goal=frozenset(done | {("is-closed", name) for name in spec.ends_closed}),
    )


def atoms_of(spec: TaskSpec, condition: Condition) -> frozenset[Atom]:
    """Returns the atoms of a condition, e.g. of a stage or of a task's success."""
    items, names = things(spec), spec.articulations
    return frozenset(
        (
            *(("holding", items[k]) for k in condition.held),
            *(("at", items[k], f"{items[k]}-goal") for k in condition.placed),
            *(("is-open", names[j]) for j in condition.opened),
            *(("is-closed", names[j]) for j in condition.closed),
        )
    )
