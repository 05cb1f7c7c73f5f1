"""Plans, and the saved ones: running an agent needs no planner."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from hab_planner.errors import PlannerError
from hab_planner.problem import task_of

PLANS = Path(__file__).parent / "plans"

SKILLS = {
    "navigate": "navigate",
    "pick": "pick",
    "place": "place",
    "place-inside": "place",
    "open": "open",
    "close": "close",
}
"""Action -> skill; open and close also say what of: ``open_drawer``, ``close_fridge``."""


@dataclass(frozen=True, kw_only=True)
class Action:
    """One step of a plan.

    Attributes:
        name: The action's.
        things: Its arguments.
    """

    name: str
    things: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.name}({', '.join(self.things)})"

    @property
    def skill(self) -> str:
        """Name of the skill that does it."""
        skill = SKILLS[self.name]
        return f"{skill}_{self.things[0]}" if skill in ("open", "close") else skill


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Actions in their order.

    Attributes:
        task: Name of the problem.
        actions: What is done.
    """

    task: str
    actions: tuple[Action, ...]

    def to_json(self) -> str:
        """Returns the text of a plan file."""
        return json.dumps(asdict(self), indent=1) + "\n"

    @staticmethod
    def from_json(text: str) -> Plan:
        """Reads the text of a plan file.

        Raises:
            PlannerError: No plan, or an action that there is not.
        """
        try:
            found = json.loads(text)
            actions = tuple(
                Action(name=action["name"], things=tuple(action["things"]))
                for action in found["actions"]
            )
            task = str(found["task"])
        except (ValueError, KeyError, TypeError) as error:
            raise PlannerError(f"This is no plan file ({error!r}).") from error
        unknown = sorted({action.name for action in actions} - SKILLS.keys())
        if unknown:
            raise PlannerError(f"A plan holds {unknown}; actions are {', '.join(SKILLS)}.")
        return Plan(task=task, actions=actions)


def saved_plan(env_id: str) -> Plan:
    """Returns the plan that is kept beside the domain (S H.1: solved once per task).

    Raises:
        PlannerError: Not the id of a task.
    """
    file = PLANS / f"{task_of(env_id).name}.json"
    return Plan.from_json(file.read_text(encoding="utf-8"))
