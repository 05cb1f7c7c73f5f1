"""Compiled task: objects to move, order of skills, stages (S G.2, H.3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from hab_tasks.arrays import Bools, Ints, norm
from hab_tasks.articulations import ARTICULATION_KINDS, ArticulationKind
from hab_tasks.constants import PLACE_RADIUS_M
from hab_tasks.engine.goals import Goals
from hab_tasks.engine.measures import Tracker
from hab_tasks.engine.skill_env import Skill
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.errors import UnknownNameError
from hab_tasks.registration import TASK_SKILLS, class_of
from hab_tasks.skills.close_drawer import CLOSE_DRAWER
from hab_tasks.skills.close_fridge import CLOSE_FRIDGE
from hab_tasks.skills.navigate import NAVIGATE
from hab_tasks.skills.open_drawer import OPEN_DRAWER
from hab_tasks.skills.open_fridge import OPEN_FRIDGE
from hab_tasks.skills.pick import PICK
from hab_tasks.skills.place import PLACE
from hab_tasks.task_spec import Interaction, TaskSpec, interactions

Destination = Literal["start", "goal", "handle"]


@dataclass(frozen=True, kw_only=True)
class Condition:
    """Condition on the state of a task, given by indices of objects, doors and drawers.

    Attributes:
        held: Objects in the hand.
        placed: Objects at rest within 0.15 m of their goal and not held.
        opened: Doors and drawers that are open.
        closed: Doors and drawers that are closed.
    """

    held: tuple[int, ...] = ()
    placed: tuple[int, ...] = ()
    opened: tuple[int, ...] = ()
    closed: tuple[int, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Part:
    """One skill in a task's order of skills (S H.3).

    Attributes:
        skill: The skill.
        object: Index of the object it is about.
        articulation: Number of the door or drawer it is about.
        to: Navigation goal: the object's ``start`` or ``goal``, or the ``handle``.
    """

    skill: Skill
    object: int = 0
    articulation: int = 0
    to: Destination = "start"


@dataclass(frozen=True, kw_only=True)
class Task:
    """A task as run by the environment; see `hab_tasks.tasks.base`.

    Attributes:
        objects: Number of objects to move.
        articulations: The doors and drawers that conditions and parts number.
        parts: The skills in order.
        stages: Stage name -> condition, in the order of partial evaluation (S G.2).
        goal: The condition of success.
        spec: Its declaration.
    """

    name: str
    horizon_steps: int
    objects: int
    parts: tuple[Part, ...]
    stages: dict[str, Condition]
    goal: Condition
    spec: TaskSpec
    articulations: tuple[ArticulationKind, ...] = ()


class Facts:
    """Flags: which objects are held and placed, which doors and drawers are open and closed.

    Skills, tasks and planning predicates share the thresholds.
    """

    def __init__(self, task: Task) -> None:
        """Prepares a task's conditions."""
        self._task = task
        conditions = (*task.stages.values(), task.goal)
        needed = [_flags(condition, task) for condition in conditions]
        self._free = ~np.array(needed, dtype=bool)
        self.goal = len(needed) - 1

    def read(self, s: Snapshot, g: Goals, tracker: Tracker) -> Bools:
        """Returns the flags (N, 2 K + 2 J): held, placed, opened, closed."""
        held = s.held[:, None] == tracker.targets
        gap_m = norm(s.objects_m - g.goals_m)
        flags = [held, (gap_m < PLACE_RADIUS_M) & ~held & tracker.at_rest()]
        if self._task.articulations:
            share = (s.joints - g.joint_lower) / (g.joint_upper - g.joint_lower)
            kinds = enumerate(self._task.articulations)
            opened = [kind.is_open(s.joints[:, j], share[:, j]) for j, kind in kinds]
            closed = [
                kind.is_closed(s.joints[:, j]) for j, kind in enumerate(self._task.articulations)
            ]
            flags += [np.stack(opened, 1), np.stack(closed, 1)]
        return np.concatenate(flags, 1)

    def holds(self, flags: Bools, condition: Ints | int | Condition) -> Bools:
        """Whether conditions hold, (N,) bool.

        Args:
            flags: (N, 2 K + 2 J) flags of `read`.
            condition: Index of a stage, one for all rows or (N,); `goal` for the task's goal; or
                any other condition.
        """
        if isinstance(condition, Condition):
            free = ~np.array(_flags(condition, self._task), dtype=bool)
        else:
            free = self._free[condition]
        return np.logical_and.reduce(flags | free, axis=-1)


def _flags(condition: Condition, task: Task) -> list[bool]:
    """Returns which flags a condition requires."""
    objects, articulations = range(task.objects), range(len(task.articulations))
    return [
        *(k in condition.held for k in objects),
        *(k in condition.placed for k in objects),
        *(j in condition.opened for j in articulations),
        *(j in condition.closed for j in articulations),
    ]


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
    return class_of(TASK_SKILLS[name]).skill


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
