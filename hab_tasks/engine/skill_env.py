"""Definition of a skill, and the environment that runs one."""

from __future__ import annotations

import importlib
import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np

from hab_tasks.arrays import Bools, Floats
from hab_tasks.engine.goals import Goals, Requirements
from hab_tasks.engine.hab_env import HabEnv
from hab_tasks.engine.measures import MEANINGS, Measures
from hab_tasks.engine.rows import Rows
from hab_tasks.engine.rules import Rules, StepResult
from hab_tasks.engine.sensors import HANDLE, ObsEntry, observation_doc, of_robot
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.episodes.generators.base import Generator
from hab_tasks.episodes.schema import Episode
from hab_tasks.errors import OptionError, UnknownNameError
from hab_tasks.instructions import FIXED, Words, skill_instruction


def config_values(config: Any) -> dict[str, float]:
    """Returns the values of a configuration by name: ``weights.force``, ``force_limit_n``."""
    found: dict[str, float] = {}
    for field in fields(config):
        value = getattr(config, field.name)
        if is_dataclass(value):
            found |= {f"{field.name}.{name}": v for name, v in config_values(value).items()}
        else:
            found[field.name] = value
    return found


def configured(skill: str, config: Any, changes: Mapping[str, float]) -> Any:
    """Returns a configuration with overrides by name, as in `config_values`.

    Raises:
        UnknownNameError: Unknown name.
        OptionError: A value is not a finite number from 0.
    """
    known = config_values(config)
    for name, value in changes.items():
        if name not in known:
            raise UnknownNameError(f"name in skill_config of {skill}", name, known)
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number or not math.isfinite(value) or value < 0.0:
            option = f"skill_config {name!r} of {skill}"
            raise OptionError.of_value(option, value, "a finite number from 0")
        config = _with(config, name.split("."), float(value))
    return config


def _with(config: Any, path: list[str], value: float) -> Any:
    first, *rest = path
    return replace(config, **{first: _with(getattr(config, first), rest, value) if rest else value})


@dataclass(frozen=True, kw_only=True)
class Skill:
    """A skill as data and pure functions; a new skill is one file with one instance.

    Attributes:
        starts: Generator of its start states.
        requirements: Requirements on episodes and simulation.
        observation: Entries of the state observation, in order.
        measures: Names of the `Measures` reported in `info`.
        success: (snapshot, measures, goals, config) -> (N,) bool.
        failures: (snapshot, measures, goals, config) -> name -> (N,) bool.
        reward_terms: (snapshot, measures, goals, config, ends) -> name -> (N,) float32; `ends`
            holds ``success`` and every failure.
        mask_gripper: (gripper, measures) -> the masked gripper action, (N,).
        scores: (measures, success, maximum end-effector displacement per action [m]) -> name ->
            (N,), reported among the measures.
        bound: (config) -> maximum reward of a step; divides the normalised reward.
        instruction: Template for `skill_instruction`, or a function of the episode that returns it.
        taken_back: (measures, config) -> (N,), reward that a task takes back when a drop or another
            grasp would let a cycle be paid again; None if no cycle can be.
        done_in_task: Like `success`, the condition on which a task advances to its next skill;
            None for `success`.
    """

    name: str
    config: Any
    starts: type[Generator]
    requirements: Requirements
    horizon_steps: int
    control_modes: tuple[str, ...]
    observation: tuple[ObsEntry, ...]
    measures: tuple[str, ...]
    success: Callable[[Snapshot, Measures, Goals, Any], Bools]
    reward_terms: Callable[..., dict[str, Floats]]
    bound: Callable[[Any], float]
    instruction: str | Callable[[Episode], str]
    failures: Callable[[Snapshot, Measures, Goals, Any], dict[str, Bools]] = lambda s, m, g, c: {}
    mask_gripper: Callable[[Floats, Measures], Floats] = lambda gripper, m: gripper
    scores: Callable[[Measures, Bools, float], dict[str, Floats]] = lambda m, success, ee_step_m: {}
    taken_back: Callable[[Measures, Any], Floats] | None = None
    done_in_task: Callable[[Snapshot, Measures, Goals, Any], Bools] | None = None

    @property
    def reward_bound(self) -> float:
        """Maximum reward of a step."""
        return self.bound(self.config)

    @property
    def score_names(self) -> tuple[str, ...]:
        """Names of its `scores`."""
        nothing: dict[str, Any] = dict.fromkeys(MEANINGS, np.zeros(1, np.float32))
        zeros = Measures(**nothing)
        # Their names only; they are computed from whatever numbers there are.
        return tuple(self.scores(zeros, np.zeros(1, bool), 1.0))

    def changed(self, changes: Mapping[str, float]) -> Skill:
        """Returns the skill with overridden weights and thresholds; see `configured`."""
        return replace(self, config=configured(self.name, self.config, changes))

    def task_reward_terms(
        self, s: Snapshot, m: Measures, g: Goals, ends: dict[str, Bools]
    ) -> dict[str, Floats]:
        """Returns the reward terms in a task, where episodes go on after a drop."""
        terms = self.reward_terms(s, m, g, self.config, ends)
        if self.taken_back is not None:
            terms["taken_back"] = -self.taken_back(m, self.config)
        return terms

    def done(self, s: Snapshot, m: Measures, g: Goals) -> Bools:
        """Whether a task advances to its next skill, (N,) bool."""
        return (self.done_in_task or self.success)(s, m, g, self.config)


class SkillRules(Rules):
    """Evaluates the functions of a skill."""

    def __init__(self, skill: Skill, rows: Rows) -> None:
        """Applies `skill` to all episodes of `rows`."""
        super().__init__(rows)
        self._skill = skill

    def step_result(self) -> StepResult:
        """See `Rules`."""
        skill, rows = self._skill, self.rows
        s, m, g = rows.snapshot, rows.measures, rows.goals
        shown = m.scalars(skill.measures)
        return StepResult(
            success=skill.success(s, m, g, skill.config),
            failures=skill.failures(s, m, g, skill.config),
            # Called later, with the ends: the bonus depends on failures.
            reward_terms=partial(skill.reward_terms, s, m, g, skill.config),
            measures=lambda success: shown | skill.scores(m, success, rows.ee_step_m),
        )

    def masked_gripper(self, gripper: Floats) -> Floats:
        """Applies the skill's mask."""
        return self._skill.mask_gripper(gripper, self.rows.measures)


class SkillEnv(HabEnv):
    """Runs one `Skill`; see `HabEnv` for the options."""

    skill: ClassVar[Skill]

    def __init_subclass__(cls) -> None:
        """Copies the skill's attributes to the class, and fills the fields of its docstring."""
        skill = cls.skill
        cls.name, cls.requirements = skill.name, skill.requirements
        cls.horizon_steps = skill.horizon_steps
        cls.control_modes = skill.control_modes
        cls.observation = of_robot(skill.observation, cls.robot)
        cls.reward_bound, cls.score_names = skill.reward_bound, skill.score_names
        cls.handle = HANDLE if skill.requirements.articulations else None
        if cls.__doc__ is not None:
            text = inspect.cleandoc(cls.__doc__).replace("{horizon}", f"{cls.horizon_steps} steps")
            table = observation_doc(cls.observation, cls.cameras)
            cls.__doc__ = text.replace("{observation}", table)

    @classmethod
    def instruct(cls, episode: Episode, words: Words = FIXED) -> str:
        """Returns the instruction of an episode in words."""
        said = cls.skill.instruction
        return skill_instruction(said if isinstance(said, str) else said(episode), episode, words)

    def configure(self, changes: Mapping[str, float]) -> None:
        """Overrides weights and thresholds of the skill."""
        # Of this instance; other environments of the class keep the paper's.
        self.skill = self.skill.changed(changes)  # type: ignore[misc]
        self.reward_bound = self.skill.reward_bound  # type: ignore[misc]

    def rules_of(self, rows: Rows) -> SkillRules:
        """Returns the rules of the skill."""
        return SkillRules(self.skill, rows)

    def ask(self, function: str, **named: Any) -> Any:
        """Returns what ``module:function`` says of this environment, e.g. the action of an expert.

        In a vector environment, ``env.call("ask", "module:function")`` runs it in each worker.
        """
        module, _, name = function.partition(":")
        return getattr(importlib.import_module(module), name)(self, **named)
