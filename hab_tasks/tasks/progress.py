"""Progress of each row in a task: stages reached, and the current skill."""

from __future__ import annotations

from torch import Tensor

from hab_tasks.arrays import BatchArray, as_kind_of, put_rows, to_tensor, zeros
from hab_tasks.engine.goals import Goals
from hab_tasks.engine.measures import Focus, Measures, Tracker
from hab_tasks.engine.skill_env import Skill
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.tasks.base import Condition, Facts, Task


class Progress:
    """Progress of each row; advances once per control step.

    Attributes:
        stages: (N,) number of stages reached, in order.
        part: (N,) index of the current part, which pays the reward of this step.
        done: (N,) whether that part has succeeded: the next step belongs to the next part.
        succeeded: (N,) whether it succeeded in this step. The last part stays done, and pays once.
    """

    _flags: BatchArray
    _told: dict[str, Tensor]

    def __init__(self, task: Task, like: BatchArray) -> None:
        """Starts all rows at the first part; `like` (N,) int sets array type and device."""
        self._task = task
        self.stages = zeros(len(like), like=like)
        self.part = zeros(len(like), like=like)
        self.done = self.succeeded = self.stages > 0
        self._everywhere = ~self.done
        self._told_of: BatchArray | None = None
        self._facts = Facts(task, self.done)
        self._objects = as_kind_of([part.object for part in task.parts], like)
        self._articulations = as_kind_of([part.articulation for part in task.parts], like)

    @property
    def focus(self) -> Focus:
        """Focus of the current parts."""
        return Focus(object=self._objects[self.part], articulation=self._articulations[self.part])

    def begin(self, rows: Tensor, s: Snapshot, g: Goals, tracker: Tracker) -> None:
        """Starts `rows` (R,) at the first part."""
        self.stages, self.part, self.done, self.succeeded = (
            put_rows(value, rows, 0)
            for value in (self.stages, self.part, self.done, self.succeeded)
        )
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
        """Advances by one control step.

        Args:
            s: Snapshot after the step.
            m: Measures of the step.
            g: Goals of the episodes.
            tracker: Which objects are targets, and which are at rest.
        """
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

    def success(self) -> BatchArray:
        """Whether the task's goal is reached, (N,) bool."""
        return self._facts.holds(self._flags, self._facts.goal)

    def holds(self, condition: Condition) -> BatchArray:
        """Whether a condition holds in the current step, (N,) bool."""
        return self._facts.holds(self._flags, condition)

    def reached(self) -> dict[str, Tensor]:
        """Returns stage name -> (N,) bool, latched; cached until another stage is reached."""
        if self._told_of is not self.stages:
            names = enumerate(self._task.stages)
            self._told = {name: to_tensor(self.stages > i) for i, name in names}
            self._told_of = self.stages
        return self._told

    def current(self) -> dict[str, BatchArray]:
        """Returns the current part: its ``number`` (N,)."""
        return {"number": self.part}

    def doing(self) -> list[tuple[Skill, BatchArray]]:
        """Returns each current skill with a mask of its rows (N,)."""
        skills = [self._task.parts[number].skill for number in self.part.tolist()]
        if len(skills) == 1:
            return [(skills[0], self._everywhere)]
        named = {skill.name: skill for skill in skills}
        return [
            (skill, as_kind_of([other.name == name for other in skills], self.done))
            for name, skill in named.items()
        ]

    def get_state(self) -> dict[str, Tensor]:
        """Returns copies of the complete state by name."""
        return {
            "stages": to_tensor(self.stages),
            "part": to_tensor(self.part),
            "done": to_tensor(self.done),
            "succeeded": to_tensor(self.succeeded),
        }

    def set_state(
        self, state: dict[str, Tensor], rows: Tensor, s: Snapshot, g: Goals, tracker: Tracker
    ) -> None:
        """Restores `rows` (R,) from a state of R rows, at the current snapshot."""
        self.stages = put_rows(self.stages, rows, state["stages"])
        self.part = put_rows(self.part, rows, state["part"])
        self.done = put_rows(self.done, rows, state["done"])
        self.succeeded = put_rows(self.succeeded, rows, state["succeeded"])
        self._flags = self._facts.read(s, g, tracker)
