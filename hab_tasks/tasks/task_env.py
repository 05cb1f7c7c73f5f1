"""Environment of a task."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

from torch import Tensor

from hab_tasks.arrays import to_tensor
from hab_tasks.engine.goals import Requirements
from hab_tasks.engine.hab_env import HabEnv
from hab_tasks.engine.rows import Rows
from hab_tasks.engine.sensors import PROPRIOCEPTION, handles_in_base, targets_in_base
from hab_tasks.episodes.schema import Episode
from hab_tasks.errors import UnknownNameError
from hab_tasks.instructions import task_instruction
from hab_tasks.robots.control_modes import MOBILE_MODES
from hab_tasks.tasks.base import Condition, Task
from hab_tasks.tasks.task_rules import TaskRules


class TaskEnv(HabEnv):
    """Runs one `Task`; see `HabEnv` for the options.

    ``info`` also holds ``stages`` (name -> whether it was reached, in order and for good) and
    ``part``, with the ``number`` of what is being done, which pays the reward.
    """

    task: ClassVar[Task]

    def __init_subclass__(cls) -> None:
        """Copies the task's attributes to the class."""
        task = cls.task
        cls.name, cls.horizon_steps = task.name, task.horizon_steps
        cls.requirements = Requirements(
            objects=task.objects,
            articulations=task.articulations,
            goals=True,
            navigates=True,
            takes="any",
        )
        cls.control_modes = MOBILE_MODES
        cls.observation = (*PROPRIOCEPTION, targets_in_base(task.objects))
        cls.handle = handles_in_base(len(task.articulations)) if task.articulations else None
        cls.reward_bound = max(part.skill.reward_bound for part in task.parts)

    @classmethod
    def default_id(cls) -> str:
        """Returns the id of the task's declaration."""
        return cls.task.spec.id

    @classmethod
    def instruct(cls, episode: Episode) -> str:
        """Returns the instruction of an episode in words."""
        return task_instruction(cls.task.spec, episode)

    def configure(self, changes: Mapping[str, float]) -> None:
        """Overrides weights and thresholds of the task's skills: ``pick.weights.force``."""
        by_skill: dict[str, dict[str, float]] = {}
        known = {part.skill.name: part.skill for part in self.task.parts}
        for name, value in changes.items():
            skill, _, rest = name.partition(".")
            if skill not in known:
                raise UnknownNameError(f"skill in skill_config of {self.name}", name, known)
            by_skill.setdefault(skill, {})[rest] = value
        changed = {name: known[name].changed(new) for name, new in by_skill.items()}
        parts = (replace(p, skill=changed.get(p.skill.name, p.skill)) for p in self.task.parts)
        self.task = replace(self.task, parts=tuple(parts))  # type: ignore[misc]
        self.reward_bound = max(p.skill.reward_bound for p in self.task.parts)  # type: ignore[misc]

    def rules_of(self, rows: Rows) -> TaskRules:
        """Returns the rules of the task."""
        return TaskRules(self.task, rows)

    def holds(self, condition: Condition) -> Tensor:
        """Returns whether a condition holds now, by the rules of success, (1,)."""
        rules: Any = self.rules
        return to_tensor(rules.progress.holds(condition)[self.here])
