"""How far each row has come in a task: stages reached, and the skill that is being done."""

from __future__ import annotations

from torch import Tensor

from hab_tasks.arrays import Rows, as_kind_of, put_rows, to_tensor, zeros
from hab_tasks.goals import Goals
from hab_tasks.measures import Focus, Measures
from hab_tasks.skills.base import Skill
from hab_tasks.snapshot import Snapshot
from hab_tasks.tasks.base import Condition, Facts, Task


class Progress:
    """Advances once for each control step.

    Attributes:
        stages: (N,) how many stages were reached, in their order.
        part: (N,) number of the part that is being done; it pays the reward of this step.
        done: (N,) whether that part has succeeded: the next step belongs to the next part.
        succeeded: (N,) whether it did so in this step. The last part stays done, and is paid once.
    """

    _flags: Rows
    _told: dict[str, Tensor]

    def __init__(self, task: Task, like: Rows) -> None:
        """Starts all rows at the first part; `like` (N,) of integers tells kind and device."""
        self._task = task
        self.stages = zeros(len(like), like=like)
        self.part = zeros(len(like), like=like)
        self.done = self.succeeded = self.stages > 0
        self._everywhere = ~self.done
        self._told_of: Rows | None = None
        self._facts = Facts(task, self.done)
        self._objects = as_kind_of([part.object for part in task.parts], like)
        self._fronts = as_kind_of([part.front for part in task.parts], like)

    @property
    def focus(self) -> Focus:
        """What the present parts are about."""
        return Focus(object=self._objects[self.part], front=self._fronts[self.part])

    def begin(self, rows: Tensor, s: Snapshot, g: Goals, targets: Rows) -> None:
        """Starts `rows` (R,) at the first part."""
        self.stages, self.part, self.done, self.succeeded = (
            put_rows(value, rows, 0)
            for value in (self.stages, self.part, self.done, self.succeeded)
        )
        self._flags = self._facts.read(s, g, targets)

    def move_on(self) -> list[int]:
        """Goes to the next part where one is done; returns the rows that did."""
        going = self.done & (self.part < len(self._task.parts) - 1)
        if not going.any():
            return []
        self.part = self.part + going
        self.done = self.done & ~going
        return [row for row, went in enumerate(going.tolist()) if went]

    def advance(self, s: Snapshot, m: Measures, g: Goals, targets: Rows) -> None:
        """Takes a control step's snapshot and measures; `targets` (N, K) as the tracker's."""
        self._flags = self._facts.read(s, g, targets)
        # The row after the last stage is the goal's; it must not count as a stage.
        reached = self._facts.holds(self._flags, self.stages)
        reached = reached & (self.stages < len(self._task.stages))
        if reached.any():
            self.stages = self.stages + reached
        before = self.done
        for skill, here in self.doing():
            self.done = self.done | (skill.done(s, m, g) & here)
        self.succeeded = self.done & ~before

    def success(self) -> Rows:
        """Whether the task's goal is reached, (N,) bool."""
        return self._facts.holds(self._flags, self._facts.goal)

    def holds(self, condition: Condition) -> Rows:
        """Whether a condition on the task's things holds at this moment, (N,) bool."""
        return self._facts.holds(self._flags, condition)

    def reached(self) -> dict[str, Tensor]:
        """Returns stage name -> (N,) bool, once reached for good; the same until one more is."""
        if self._told_of is not self.stages:
            names = enumerate(self._task.stages)
            self._told = {name: to_tensor(self.stages > i) for i, name in names}
            self._told_of = self.stages
        return self._told

    def current(self) -> dict[str, Rows]:
        """Returns what is being done: ``number``, (N,), of the part."""
        return {"number": self.part}

    def doing(self) -> list[tuple[Skill, Rows]]:
        """Returns each skill that some row is doing now, and which rows (N,) do."""
        skills = [self._task.parts[number].skill for number in self.part.tolist()]
        if len(skills) == 1:
            return [(skills[0], self._everywhere)]
        named = {skill.name: skill for skill in skills}
        return [
            (skill, as_kind_of([other.name == name for other in skills], self.done))
            for name, skill in named.items()
        ]

    def get_state(self) -> dict[str, Tensor]:
        """Returns copies of all there is, by name."""
        return {
            "stages": to_tensor(self.stages),
            "part": to_tensor(self.part),
            "done": to_tensor(self.done),
            "succeeded": to_tensor(self.succeeded),
        }

    def set_state(
        self, state: dict[str, Tensor], rows: Tensor, s: Snapshot, g: Goals, targets: Rows
    ) -> None:
        """Restores `rows` (R,) from what `get_state` returned for R rows, at this moment."""
        self.stages = put_rows(self.stages, rows, state["stages"])
        self.part = put_rows(self.part, rows, state["part"])
        self.done = put_rows(self.done, rows, state["done"])
        self.succeeded = put_rows(self.succeeded, rows, state["succeeded"])
        self._flags = self._facts.read(s, g, targets)
