"""What every skill is made of, and the environment that runs one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

from hab_tasks.arrays import Rows
from hab_tasks.goals import Goals
from hab_tasks.measures import Measures
from hab_tasks.sensors import HANDLE, ObsEntry
from hab_tasks.skills.hab_env import HabEnv, Verdict
from hab_tasks.skills.needs import Needs
from hab_tasks.snapshot import Snapshot


def free_gripper(gripper: Rows, m: Measures) -> Rows:
    """Carries out every gripper entry (N,)."""
    return gripper


def no_failures(s: Snapshot, m: Measures, g: Goals, c: Any) -> dict[str, Rows]:
    """Nothing ends the episode but success and the horizon."""
    return {}


def no_scores(m: Measures, success: Rows) -> dict[str, Rows]:
    """Nothing is measured beside `Measures`."""
    return {}


@dataclass(frozen=True, kw_only=True)
class Skill:
    """A skill as data and pure functions; a new skill is one file with one of these.

    Attributes:
        needs: What of the simulation it asks about.
        observation: Entries of the state observation, in order.
        measures: Names of the `Measures` that are shown in `info`.
        success: (snapshot, measures, goals, config) -> (N,) bool.
        failures: (snapshot, measures, goals, config) -> name -> (N,) bool.
        reward_terms: (snapshot, measures, goals, config, ends) -> name -> (N,) float32; `ends`
            holds ``success`` and every failure.
        mask_gripper: (gripper, measures) -> the gripper entry that is carried out, (N,).
        scores: (measures, success) -> name -> (N,), shown among the measures.
        reward_bound: No step can pay more; divides the normalised reward.
        done_in_task: As `success`, where a task goes on to its next skill; None for `success`.
    """

    name: str
    config: Any
    needs: Needs
    horizon_steps: int
    control_modes: tuple[str, ...]
    observation: tuple[ObsEntry, ...]
    measures: tuple[str, ...]
    success: Callable[[Snapshot, Measures, Goals, Any], Rows]
    reward_terms: Callable[..., dict[str, Rows]]
    reward_bound: float
    failures: Callable[[Snapshot, Measures, Goals, Any], dict[str, Rows]] = no_failures
    mask_gripper: Callable[[Rows, Measures], Rows] = free_gripper
    scores: Callable[[Measures, Rows], dict[str, Rows]] = no_scores
    done_in_task: Callable[[Snapshot, Measures, Goals, Any], Rows] | None = None

    def done(self, s: Snapshot, m: Measures, g: Goals) -> Rows:
        """Whether a task goes on to its next skill, (N,) bool."""
        return (self.done_in_task or self.success)(s, m, g, self.config)


class SkillEnv(HabEnv):
    """Runs one `Skill`; see `HabEnv` for the options."""

    skill: ClassVar[Skill]

    def __init_subclass__(cls) -> None:
        """Takes over what the skill says."""
        skill = cls.skill
        cls.name, cls.needs, cls.horizon_steps = skill.name, skill.needs, skill.horizon_steps
        cls.control_modes, cls.observation = skill.control_modes, skill.observation
        cls.reward_bound = skill.reward_bound
        cls.handle = HANDLE if skill.needs.fronts else None

    def judge(self, snapshot: Snapshot, measures: Measures) -> Verdict:
        """Asks the skill's functions."""
        skill, goals = self.skill, self._world.goals
        shown = measures.scalars(skill.measures)
        return Verdict(
            success=skill.success(snapshot, measures, goals, skill.config),
            failures=skill.failures(snapshot, measures, goals, skill.config),
            reward_terms=partial(skill.reward_terms, snapshot, measures, goals, skill.config),
            measures=lambda success: shown | skill.scores(measures, success),
        )

    def masked_gripper(self, gripper: Rows, measures: Measures) -> Rows:
        """Asks the skill's mask."""
        return self.skill.mask_gripper(gripper, measures)
