"""Stages of a plan: its interactions, and the point that each is about."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from hab_plans.plan import Action
from hab_plans.problem import ROOM, things
from hab_tasks.task_spec import TaskSpec, behind, interactions
from hab_tasks.tasks.base import Condition, Task


@dataclass(frozen=True, kw_only=True)
class Stage:
    """An interaction of a plan.

    Attributes:
        action: The action.
        skill: Name of the skill, e.g. ``open_drawer``.
        object: Index of the object that the skill is about.
        at: Whether the skill observes the object's ``start`` or its ``goal``.
        articulation: Number of the door or drawer that the skill moves; None without one.
        drawer: Number of the drawer that carries the object; None without one.
        effect: Condition that holds after success.
    """

    action: Action
    skill: str
    object: int
    at: Literal["start", "goal"]
    articulation: int | None
    drawer: int | None
    effect: Condition

    @property
    def number(self) -> int:
        """Number of the door or drawer that the skill moves, else of its object."""
        return self.object if self.articulation is None else self.articulation

    @property
    def handles_object(self) -> bool:
        """Whether the skill picks or places, rather than opening or closing."""
        return self.articulation is None


def stage_of(task: Task, action: Action) -> Stage:
    """Returns the stage of a plan's action, other than navigation.

    A skill that opens or closes observes an object behind the door or in the drawer, at its start
    or, if it is only to be put there, at its goal (S H.2).
    """
    spec, articulation = task.spec, None
    if action.verb in ("open", "close"):
        articulation = spec.articulations.index(action.things[0])
        number = _object_behind(spec, action)
        inside = behind(spec, spec.targets[number].start) == action.things[0]
    else:
        number = things(spec).index(action.things[0])
        inside = action.verb == "pick"
    return Stage(
        action=action,
        skill=action.skill,
        object=number,
        at="start" if inside else "goal",
        articulation=articulation,
        # What has been let go elsewhere is no longer carried by a drawer.
        drawer=_drawer(spec, number) if inside and ROOM not in action.things else None,
        effect=_effect(action, number if articulation is None else articulation),
    )


def _effect(action: Action, number: int) -> Condition:
    """Returns the condition that an action is for."""
    if action.verb in ("open", "close"):
        return Condition(**{"opened" if action.verb == "open" else "closed": (number,)})
    return Condition(held=(number,)) if action.verb == "pick" else Condition(placed=(number,))


def _object_behind(spec: TaskSpec, action: Action) -> int:
    """Returns the index of the object for which a door or drawer is opened or closed."""
    name = action.things[0]
    for item in interactions(spec):
        if (item.kind, item.articulation) == (action.verb, name):
            return item.target
    # Only a plan made after a failure moves what the task's own plan leaves alone.
    users = [
        number
        for number, target in enumerate(spec.targets)
        if name in (behind(spec, target.start), behind(spec, spec.goal_of(target)))
    ]
    return users[-1] if users else 0


def _drawer(spec: TaskSpec, number: int) -> int | None:
    """Returns the number of the drawer in which an object starts, if the task moves it."""
    name = behind(spec, spec.targets[number].start)
    return spec.articulations.index(name) if name == "drawer" else None
