"""What every task is made of: objects to move, the order of skills, partial goals (S G.2, H.3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from hab_tasks.arrays import Rows, as_kind_of, concat, norm, stack
from hab_tasks.constants import PLACE_RADIUS_M
from hab_tasks.fronts import FrontKind
from hab_tasks.goals import Goals
from hab_tasks.skills.base import Skill
from hab_tasks.snapshot import Snapshot


@dataclass(frozen=True, kw_only=True)
class Condition:
    """What has to hold at one moment: numbers of objects, and of doors and drawers.

    Attributes:
        held: Objects in the hand.
        placed: Objects within 0.15 m of their goal and not in the hand.
        opened: Doors and drawers that are open.
        closed: Doors and drawers that are closed.
    """

    held: tuple[int, ...] = ()
    placed: tuple[int, ...] = ()
    opened: tuple[int, ...] = ()
    closed: tuple[int, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Part:
    """One skill in the order in which a task is done (S H.3).

    Attributes:
        skill: The skill.
        object: Number of the object it is about.
        front: Number of the door or drawer it is about.
        to: Where Navigate leads: the object's ``start`` or ``goal``, or the ``handle``.
    """

    skill: Skill
    object: int = 0
    front: int = 0
    to: Literal["start", "goal", "handle"] = "start"


@dataclass(frozen=True, kw_only=True)
class Task:
    """A task as data; a new task is one file with one of these.

    Attributes:
        objects: How many objects are to be moved.
        fronts: The doors and drawers that conditions and parts number.
        parts: The skills in their order.
        stages: Name -> condition, in the order of partial evaluation (S G.2).
        goal: The condition of success.
    """

    name: str
    horizon_steps: int
    objects: int
    parts: tuple[Part, ...]
    stages: dict[str, Condition]
    goal: Condition
    fronts: tuple[FrontKind, ...] = ()


class Facts:
    """Which objects are held and placed, which fronts are open and closed, as one row of flags.

    Skills, tasks and planning predicates share the thresholds.
    """

    def __init__(self, task: Task, like: Rows) -> None:
        """Takes a task's conditions; `like` (N,) bool tells kind and device."""
        self._task = task
        conditions = (*task.stages.values(), task.goal)
        needed = [_flags(condition, task) for condition in conditions]
        self._free = ~as_kind_of(needed, like)
        self.goal = len(needed) - 1

    def read(self, s: Snapshot, g: Goals, targets: Rows) -> Rows:
        """Returns the flags (N, 2 K + 2 J): held, placed, opened, closed.

        Args:
            s: The moment.
            g: What the episodes ask for.
            targets: (N, K) the objects' indices in the grasp.
        """
        held = s.held[:, None] == targets
        gap_m = norm(s.objects_m - g.goals_m)
        flags = [held, (gap_m < PLACE_RADIUS_M) & ~held]
        if self._task.fronts:
            share = (s.joints - g.joint_lower) / (g.joint_upper - g.joint_lower)
            kinds = enumerate(self._task.fronts)
            opened = [kind.is_open(s.joints[:, j], share[:, j]) for j, kind in kinds]
            closed = [kind.is_closed(s.joints[:, j]) for j, kind in enumerate(self._task.fronts)]
            flags += [stack(opened, 1), stack(closed, 1)]
        return concat(flags, 1)

    def holds(self, flags: Rows, condition: Rows | int | Condition) -> Rows:
        """Whether conditions hold, (N,) bool.

        Args:
            flags: (N, 2 K + 2 J) as `read` gives them.
            condition: Number of a stage, one for all rows or (N,); `goal` is the task's goal. Or
                any condition on the task's things.
        """
        if isinstance(condition, Condition):
            free = ~as_kind_of(_flags(condition, self._task), flags)
        else:
            free = self._free[condition]
        met: Rows = flags | free
        return met.all(-1)


def _flags(condition: Condition, task: Task) -> list[bool]:
    """Returns which of the flags a condition needs."""
    objects, fronts = range(task.objects), range(len(task.fronts))
    return [
        *(k in condition.held for k in objects),
        *(k in condition.placed for k in objects),
        *(j in condition.opened for j in fronts),
        *(j in condition.closed for j in fronts),
    ]
