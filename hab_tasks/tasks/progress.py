"""Progress of each row in a task: stages reached, and the current skill."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from torch import Tensor

from hab_tasks.arrays import Bools, Ints, put_rows, to_tensors
from hab_tasks.engine.goals import Goals
from hab_tasks.engine.measures import Focus, Measures, Tracker
from hab_tasks.engine.skill_env import Skill
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.tasks.base import Condition, Facts, Task

_STATE = ("stages", "part", "done", "succeeded")


class Progress:
    """Progress of each row; advances once per control step.

    Attributes:
        stages: (N,) number of stages reached, in order.
        part: (N,) index of the current part, which pays the reward of this step.
        done: (N,) whether that part has succeeded: the next step belongs to the next part.
        succeeded: (N,) whether it succeeded in this step. The last part stays done, and pays once.
    """

    _flags: Bools
    _told: dict[str, Bools]

    def __init__(self, task: Task, count: int) -> None:
        """Starts all of `count` rows at the first part."""
        self._task = task
        self.stages: Ints = np.zeros(count, dtype=np.int64)
        self.part: Ints = np.zeros(count, dtype=np.int64)
        self.done = self.succeeded = self.stages > 0
        self._everywhere = ~self.done
        self._told_of: Ints | None = None
        self._facts = Facts(task)
        self._objects: Ints = np.array([part.object for part in task.parts])
        self._articulations: Ints = np.array([part.articulation for part in task.parts])

    @property
    def focus(self) -> Focus:
        """Focus of the current parts."""
        return Focus(object=self._objects[self.part], articulation=self._articulations[self.part])

    def begin(self, rows: Sequence[int], s: Snapshot, g: Goals, tracker: Tracker) -> None:
        """Starts `rows` (R,) at the first part."""
        for name in _STATE:
            setattr(self, name, put_rows(getattr(self, name), rows, 0))
        self._flags = self._facts.read(s, g, tracker)

    def move_on(self) -> list[int]:
        """Advances finished rows to the next part; returns those rows."""
        going = self.done & (self.part < len(self._task.parts) - 1)
        if not going.any():
            return []
        self.part = self.part + going
        self.done = self.done & ~going
        return [row for row, went in enumerate(going.tolist()) if went]

    def advance(self, s: Snapshot, m: Measures, g: Goals, tracker: Tracker) -> None:
        """Advances by one control step, with the snapshot and the measures after it."""
        self._flags = self._facts.read(s, g, tracker)
        # The entry after the last stage is the goal; it must not count as a stage.
        reached = self._facts.holds(self._flags, self.stages)
        reached = reached & (self.stages < len(self._task.stages))
        if reached.any():
            self.stages = self.stages + reached
        before = self.done
        for skill, here in self.doing():
            self.done = self.done | (skill.done(s, m, g) & here)
        self.succeeded = self.done & ~before

    def success(self) -> Bools:
        """Whether the task's goal is reached, (N,) bool."""
        return self._facts.holds(self._flags, self._facts.goal)

    def holds(self, condition: Condition) -> Bools:
        """Whether a condition holds in the current step, (N,) bool."""
        return self._facts.holds(self._flags, condition)

    def reached(self) -> dict[str, Bools]:
        """Returns stage name -> (N,) bool, latched; cached until another stage is reached."""
        if self._told_of is not self.stages:
            names = enumerate(self._task.stages)
            self._told = {name: self.stages > i for i, name in names}
            self._told_of = self.stages
        return self._told

    def current(self) -> dict[str, Ints]:
        """Returns the current part: its ``number`` (N,)."""
        return {"number": self.part}

    def doing(self) -> list[tuple[Skill, Bools]]:
        """Returns each current skill with a mask of its rows (N,)."""
        skills = [self._task.parts[number].skill for number in self.part.tolist()]
        if len(skills) == 1:
            return [(skills[0], self._everywhere)]
        named = {skill.name: skill for skill in skills}
        return [
            (skill, np.array([other.name == name for other in skills]))
            for name, skill in named.items()
        ]

    def get_state(self) -> dict[str, Tensor]:
        """Returns copies of the complete state by name."""
        return to_tensors({name: getattr(self, name) for name in _STATE})

    def set_state(
        self, state: Mapping[str, Any], rows: Sequence[int], s: Snapshot, g: Goals, tracker: Tracker
    ) -> None:
        """Restores `rows` (R,) from a state of R rows, at the current snapshot."""
        for name in _STATE:
            setattr(self, name, put_rows(getattr(self, name), rows, state[name]))
        self._flags = self._facts.read(s, g, tracker)
