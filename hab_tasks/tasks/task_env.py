"""Environments of tasks; their classes are created from the declarations on first access.

Attribute names of this module are the module that registers the task, a dot, and the environment
id: ``getattr(task_env, "hab_tasks.HabSetTable-v1")``. Gymnasium accepts such names in entry points.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any, ClassVar

from torch import Tensor

from hab_tasks.arrays import to_tensor
from hab_tasks.engine.goals import Requirements
from hab_tasks.engine.hab_env import HabEnv
from hab_tasks.engine.rows import Rows
from hab_tasks.engine.sensors import (
    PROPRIOCEPTION,
    ObsEntry,
    handles_in_base,
    observation_doc,
    of_robot,
    targets_in_base,
)
from hab_tasks.episodes.schema import Episode
from hab_tasks.errors import UnknownNameError
from hab_tasks.instructions import FIXED, Words, stage_instruction, task_instruction
from hab_tasks.receptacles import OPEN_RECEPTACLES, PHRASES
from hab_tasks.registration import TAKEN, TASKS, imported_id
from hab_tasks.robots.control_modes import MOBILE_MODES
from hab_tasks.simulator import REGISTERED_ENVS
from hab_tasks.task_spec import ARTICULATIONS, TaskSpec, TaskSpecError, interactions
from hab_tasks.tasks.base import Condition, Task, compile_task
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
        cls.observation = of_robot((*PROPRIOCEPTION, targets_in_base(task.objects)), cls.robot)
        cls.handle = handles_in_base(len(task.articulations)) if task.articulations else None
        cls.reward_bound = max(part.skill.reward_bound for part in task.parts)

    @classmethod
    def default_id(cls) -> str:
        """Returns the id of the task's declaration."""
        return cls.task.spec.id

    @classmethod
    def instruct(cls, episode: Episode, words: Words = FIXED) -> str:
        """Returns the instruction of an episode in words."""
        return task_instruction(cls.task.spec, episode, words)

    @property
    def stage_instruction(self) -> list[str]:
        """Instruction of the first stage that is not reached, one."""
        rules: Any = self.rules
        reached = int(rules.progress.stages[self.simulation.row])
        return [stage_instruction(self.task.spec, reached, self.simulation.episode, self.words)]

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


def __getattr__(name: str) -> type[TaskEnv]:
    """Returns the class of a task; imports the module that registers it."""
    module, _, env_id = name.rpartition(".")
    if not module:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    spec = TASKS[imported_id(f"{module}:{env_id}")]
    known = REGISTERED_ENVS.get(env_id)
    if known is not None and not issubclass(known.cls, TaskEnv):
        raise TaskSpecError(f"{env_id}: {TAKEN}")  # ManiSkill has registered its own meanwhile
    return env_class(spec)


@cache
def env_class(spec: TaskSpec) -> type[TaskEnv]:
    """Returns the environment class of a task."""
    made = type(spec.class_name, (TaskEnv,), {"task": compile_task(spec), "__module__": __name__})
    made.__doc__ = docstring(spec, made.observation)
    return made


WIDTH = 96

ACTION = (
    "**Action**: ``ee_base`` 3 + 1 + 2; ``joint_delta_base``, ``joint_target_base`` and "
    "``joint_state_base`` 7 + 1 + 2; ``joint_target_pose`` and ``joint_state_pose`` 7 + 1 + 3 "
    "(`hab_tasks.robots.control`)."
)


def docstring(spec: TaskSpec, observation: Sequence[ObsEntry]) -> str:
    """Returns the docstring of a task's environment class."""
    order = interactions(spec)
    skills = listed([item.stage.replace("_", " ") if item.kind in ("open", "close") else item.kind
                     for item in order])  # fmt: skip
    stages = ", ".join(f"``{item.stage}``" for item in order)
    ends = f", {listed(spec.ends_closed)} closed" if spec.ends_closed else ""
    parts = (
        spec.instruction,
        f"**Start**: {_start(spec)}",
        observation_doc(observation, ("head", "arm")),
        ACTION,
        '**Reward** (terms in ``info["reward_terms"]``, named ``skill/term``): those of the '
        "current skill; a drop takes back what the grasp has paid. "
        f"Skill order, each preceded by navigate: {skills} (S H.3).",
        f"**Stages**: {stages}, in this order (S G.2).",
        f"**Success**: every object released and at rest within 0.15 m of its goal{ends}.",
        "**Failure**: none; contact forces are not limited.",
        f"**Horizon**: {spec.horizon_steps:,} steps. "
        f"**Versions**: {spec.id.rpartition('-')[2]}, initial version.",
    )
    wrap = partial(textwrap.fill, width=WIDTH, break_long_words=False, break_on_hyphens=False)
    return "\n\n".join(part if "\n" in part else wrap(part) for part in parts) + "\n"


def listed(words: Sequence[str]) -> str:
    """Joins words with commas, and "and" before the last."""
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last


def _start(spec: TaskSpec) -> str:
    count, open_ = len(spec.targets), spec.starts_open
    closed = tuple(name for name in ARTICULATIONS if name not in open_)
    doors = [f"{listed(open_)} open"] if open_ else []
    doors += [f"{listed(closed)} closed"] if closed else []
    objects = "one object" if count == 1 else f"{count} objects"
    hidden = " Objects behind a closed door or in a closed drawer cannot be grasped."
    return (
        f"{objects} to rearrange and {spec.clutter} others {listed(_places(spec.clutter_on))}; "
        f"{', '.join(doors)}; the robot at a random free pose with random heading (S G.1)."
        f"{hidden if spec.articulations else ''}"
    )


def _places(names: tuple[str, ...]) -> tuple[str, ...]:
    """Returns the clutter receptacles in words; the open receptacles under one name."""
    usual = set(OPEN_RECEPTACLES) <= set(names)
    others = [name for name in names if not (usual and name in OPEN_RECEPTACLES)]
    found = tuple(dict.fromkeys(PHRASES[name] for name in others))
    return ("on the open receptacles", *found) if usual else found
