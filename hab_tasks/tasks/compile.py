"""Compiles a task's declaration to what the environment runs (S G.2, H.3)."""

from __future__ import annotations

import importlib

from hab_tasks.articulations import ARTICULATION_KINDS
from hab_tasks.engine.skill_env import Skill
from hab_tasks.errors import UnknownNameError
from hab_tasks.registration import ENTRY_POINTS, TASK_SKILLS
from hab_tasks.skills.close_drawer import CLOSE_DRAWER
from hab_tasks.skills.close_fridge import CLOSE_FRIDGE
from hab_tasks.skills.navigate import NAVIGATE
from hab_tasks.skills.open_drawer import OPEN_DRAWER
from hab_tasks.skills.open_fridge import OPEN_FRIDGE
from hab_tasks.skills.pick import PICK
from hab_tasks.skills.place import PLACE
from hab_tasks.task_order import Interaction, interactions
from hab_tasks.task_spec import TaskSpec
from hab_tasks.tasks.base import Condition, Destination, Part, Task

SKILLS: dict[str, Skill] = {
    skill.name: skill
    for skill in (PICK, PLACE, OPEN_DRAWER, CLOSE_DRAWER, OPEN_FRIDGE, CLOSE_FRIDGE)
}

DESTINATIONS: dict[str, Destination] = {
    "open": "handle",
    "pick": "start",
    "place": "goal",
    "close": "handle",
}
"""Interaction -> goal of the navigation before it."""


def compile_task(spec: TaskSpec) -> Task:
    """Returns a task with its skills, stages and goal.

    Raises:
        HabError: No skill opens or closes one of its doors or drawers.
    """
    order = interactions(spec)
    parts = tuple(part for item in order for part in _parts(spec, item))  # imports their kinds
    everything = tuple(range(len(spec.targets)))
    closed = tuple(
        spec.articulations.index(name)
        for name in sorted(spec.ends_closed, key=spec.articulations.index)
    )
    return Task(
        name=spec.name,
        horizon_steps=spec.horizon_steps,
        objects=len(spec.targets),
        articulations=tuple(ARTICULATION_KINDS[name] for name in spec.articulations),
        parts=parts,
        stages=_stages(spec, order),
        goal=Condition(placed=everything, closed=closed),
        spec=spec,
    )


def _skill(name: str) -> Skill:
    """Returns the skill of a part; imports that of another package."""
    if name in SKILLS:
        return SKILLS[name]
    if name not in TASK_SKILLS:
        raise UnknownNameError("skill of tasks", name, (*SKILLS, *TASK_SKILLS))
    module, _, entry = ENTRY_POINTS[TASK_SKILLS[name]].partition(":")
    return getattr(importlib.import_module(module), entry).skill


def _parts(spec: TaskSpec, item: Interaction) -> tuple[Part, Part]:
    """Returns the parts of an interaction: navigation, then the skill."""
    name = item.articulation
    articulation = 0 if name is None else spec.articulations.index(name)
    skill = _skill(item.stage if item.kind in ("open", "close") else item.kind)
    return (
        Part(
            skill=NAVIGATE,
            object=item.target,
            articulation=articulation,
            to=DESTINATIONS[item.kind],
        ),
        Part(skill=skill, object=item.target, articulation=articulation),
    )


def _stages(spec: TaskSpec, order: tuple[Interaction, ...]) -> dict[str, Condition]:
    """Returns the condition after each interaction: its effect and earlier permanent ones."""
    placed: tuple[int, ...] = ()
    closed: tuple[int, ...] = ()
    stages: dict[str, Condition] = {}
    for item in order:
        held, opened = (), ()
        name = item.articulation
        articulation = None if name is None else spec.articulations.index(name)
        if item.kind == "pick":
            held = (item.target,)
        elif item.kind == "place":
            placed = (*placed, item.target)
        elif articulation is not None and item.kind == "open":
            opened = (articulation,)
        elif articulation is not None:
            closed = tuple(sorted((*closed, articulation)))
        stages[item.stage] = Condition(held=held, placed=placed, opened=opened, closed=closed)
    return stages
