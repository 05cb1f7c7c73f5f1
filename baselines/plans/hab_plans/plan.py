"""Plans, and the plan implied by a task's declaration, which needs no planner."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass

from hab_plans.problem import ACTION_OF, ROOM, SPAWN, spec_of, thing
from hab_tasks.task_spec import (
    Interaction,
    TaskSpec,
    behind,
    interactions,
)

SKILLS = {
    "navigate": "navigate",
    "pick": "pick",
    "place": "place",
    "place-inside": "place",
    "open": "open",
    "close": "close",
}
"""Action -> skill; open and close add the articulation: ``open_drawer``, ``close_fridge``."""


@dataclass(frozen=True, kw_only=True)
class Action:
    """One step of a plan.

    Attributes:
        name: Name of the action.
        things: Its arguments.
    """

    name: str
    things: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.name}({', '.join(self.things)})"

    @property
    def skill(self) -> str:
        """Name of the skill that executes the action."""
        skills = {action: name for name, action in ACTION_OF.items()}
        skill = skills.get(self.name) or SKILLS[self.name]
        return f"{skill}_{self.things[0]}" if skill in ("open", "close") else skill

    @property
    def verb(self) -> str:
        """What is done: ``navigate``, ``pick``, ``place``, ``open`` or ``close``."""
        return self.skill.partition("_")[0]


@dataclass(frozen=True, kw_only=True)
class Plan:
    """A sequence of actions.

    Attributes:
        task: Name of the problem.
        actions: The actions in order.
    """

    task: str
    actions: tuple[Action, ...]

    @property
    def interactions(self) -> tuple[Action, ...]:
        """The actions other than navigation."""
        return tuple(action for action in self.actions if action.name != "navigate")

    def to_json(self) -> str:
        """Returns the text of a plan file."""
        return json.dumps(asdict(self), indent=1) + "\n"


def plan_of(reference: str) -> Plan:
    """Returns the plan implied by a task's declaration: navigation before interactions (S H.1).

    It is the plan of minimal length that Fast Downward finds.

    Args:
        reference: Environment id of the task.

    Raises:
        PlannerError: Not the id of a task.
    """
    spec = spec_of(reference)
    actions: list[Action] = []
    here = SPAWN
    for item in interactions(spec):
        there, action = _action(spec, item)
        if there != here:
            actions.append(Action(name="navigate", things=(here, there)))
        actions.append(action)
        here = there
    return Plan(task=spec.name.replace("_", "-"), actions=tuple(actions))


def _action(spec: TaskSpec, item: Interaction) -> tuple[str, Action]:
    """Returns the pose and the action of an interaction."""
    target = spec.targets[item.target]
    name = thing(target.name)
    goal = f"{name}-goal"
    if item.kind == "pick":
        container = behind(spec, target.start) or ROOM
        return name, Action(name="pick", things=(name, container))
    if item.kind == "place":
        container = behind(spec, spec.goal_of(target)) or ROOM
        if target.inside is None:
            return goal, Action(name="place", things=(name, goal, container))
        other = thing(target.inside)
        things = (name, goal, other, f"{other}-goal", container)
        return goal, Action(name="place-inside", things=things)
    assert item.articulation is not None
    name = ACTION_OF.get(f"{item.kind}_{item.articulation}", item.kind)
    return item.articulation, Action(name=name, things=(item.articulation,))
