"""How far each row has come in a task: stages reached, and the skill that is being done."""

from __future__ import annotations

import torch
from torch import Tensor

from hab_tasks.goals import Goals
from hab_tasks.measures import Focus, Measures
from hab_tasks.skills.base import Skill
from hab_tasks.snapshot import Snapshot
from hab_tasks.tasks.base import Facts, Task


class Progress:
    """Advances once for each control step.

    Attributes:
        stages: (N,) how many stages were reached, in their order.
        part: (N,) number of the part that is being done; it pays the reward of this step.
        done: (N,) whether that part has succeeded: the next step belongs to the next part.
    """

    def __init__(self, task: Task, count: int, device: torch.device | str) -> None:
        self._task, self._facts = task, Facts(task, device)
        self.stages = torch.zeros(count, dtype=torch.long, device=device)
        self.part = self.stages.clone()
        self.done = self.stages > 0
        self._everywhere = ~self.done
        self._objects = torch.tensor([part.object for part in task.parts], device=device)
        self._fronts = torch.tensor([part.front for part in task.parts], device=device)

    @property
    def focus(self) -> Focus:
        """What the present parts are about."""
        return Focus(object=self._objects[self.part], front=self._fronts[self.part])

    def begin(self, rows: Tensor) -> None:
        """Starts `rows` (R,) at the first part."""
        self.stages, self.part, self.done = (
            value.index_fill(0, rows, 0) for value in (self.stages, self.part, self.done)
        )

    def move_on(self) -> Tensor:
        """Goes to the next part where one is done; returns the rows (R,) that did."""
        last = len(self._task.parts) - 1
        going = self.done & (self.part < last)
        self.part = self.part + going
        self.done = self.done & ~going
        return torch.nonzero(going).flatten()

    def advance(self, s: Snapshot, m: Measures, g: Goals, targets: Tensor) -> None:
        """Takes a control step's snapshot and measures; `targets` (N, K) as the tracker's."""
        flags = self._facts.read(s, g, targets)
        # The row after the last stage is the goal's; it must not count as a stage.
        reached = self._facts.holds(flags, self.stages) & (self.stages < len(self._task.stages))
        self.stages = self.stages + reached
        self.done = self.done | self._succeeded(s, m, g)

    def success(self, s: Snapshot, g: Goals, targets: Tensor) -> Tensor:
        """Whether the task's goal is reached, (N,) bool."""
        return self._facts.holds(self._facts.read(s, g, targets), self._facts.goal)

    def reached(self) -> dict[str, Tensor]:
        """Returns stage name -> (N,) bool, once reached for good."""
        return {name: self.stages > i for i, name in enumerate(self._task.stages)}

    def get_state(self) -> dict[str, Tensor]:
        """Returns copies of all there is, by name."""
        return {
            "stages": self.stages.clone(),
            "part": self.part.clone(),
            "done": self.done.clone(),
        }

    def set_state(self, state: dict[str, Tensor], rows: Tensor) -> None:
        """Restores `rows` (R,) from what `get_state` returned for R rows."""
        for name, value in self.get_state().items():
            value[rows] = state[name].to(value.dtype)
            setattr(self, name, value)

    def _succeeded(self, s: Snapshot, m: Measures, g: Goals) -> Tensor:
        """Whether the present part's own condition holds, (N,) bool."""
        found = torch.zeros_like(self.done)
        for skill, here in self.doing():
            found = found | (skill.done(s, m, g) & here)
        return found

    def doing(self) -> list[tuple[Skill, Tensor]]:
        """Returns each skill that some row is doing now, and which rows (N,) do."""
        skills = [self._task.parts[number].skill for number in self.part.tolist()]
        if len(skills) == 1:
            return [(skills[0], self._everywhere)]
        named = {skill.name: skill for skill in skills}
        device = self.part.device
        return [
            (skill, torch.tensor([other.name == name for other in skills], device=device))
            for name, skill in named.items()
        ]
