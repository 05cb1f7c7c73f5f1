"""Compiled task: objects to move, order of skills, stages (S G.2, H.3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from hab_tasks.arrays import Bools, Ints, norm
from hab_tasks.articulations import ArticulationKind
from hab_tasks.constants import PLACE_RADIUS_M
from hab_tasks.engine.goals import Goals
from hab_tasks.engine.measures import Tracker
from hab_tasks.engine.skill_env import Skill
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.task_spec import TaskSpec

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
    """A task as run by the environment; see `hab_tasks.tasks.compile`.

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
        """Returns the flags (N, 2 K + 2 J): held, placed, opened, closed.

        Args:
            s: Current snapshot.
            g: Goals of the episodes.
            tracker: Which objects are targets, and which are at rest.
        """
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
