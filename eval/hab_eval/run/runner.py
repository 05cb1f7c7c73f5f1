"""Evaluation of an agent in N batch rows, by the episode loop of `hab_tasks.engine.rollout`.

N is 1 for most agents. Rows are in this process or in workers (`hab_eval.run.workers`).
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Protocol

from torch import Tensor

from hab_eval.records.results import FinishedEpisode, check_finished
from hab_eval.run.agent_checks import check_actions, check_report, check_reports
from hab_eval.run.observations import AgentView
from hab_eval.run.rows import LocalRows, job_of, naming_episodes, result_of
from hab_tasks.agent import Agent, AgentReport
from hab_tasks.engine import rollout
from hab_tasks.engine.rollout import Ended, EnvRow, Job, Observer, Restart, Rows, anew
from hab_tasks.errors import RunStoppedError

if TYPE_CHECKING:
    import gymnasium as gym

    from hab_tasks.episodes import Episode

TIMEOUT = "timeout"


def run_episode(
    env: gym.Env[Any, Any],
    agent: Agent,
    index: int,
    episode: Episode,
    observers: Sequence[Observer] = (),
    restart: Restart = anew,
) -> FinishedEpisode:
    """Runs one episode in a given environment and returns its result.

    Raises:
        Exception: Raised by the agent or the environment.
    """
    row = EnvRow(env, observers, view=AgentView(agent.spec), restart=restart)
    try:
        (finished,) = play(agent, LocalRows([row]), iter([job_of(index, episode)]))
    except RunStoppedError as error:
        raise error.__cause__ or error from None
    return finished


class TellingRows(Rows, Protocol):
    """Rows whose observers may need the agent's current activity.

    Attributes:
        watched: Whether they do.
        doing: The activity, by row.
    """

    watched: bool
    doing: list[str]


def play(
    agent: Agent, rows: TellingRows, jobs: Iterator[Job]
) -> Generator[FinishedEpisode, None, None]:
    """Assigns jobs to free rows and yields results as episodes finish.

    There must be at least as many jobs as rows.

    Raises:
        RunStoppedError: The agent or an environment raised; the message has the episodes.
    """
    checked = _CheckedAgent(agent, rows)
    for ended in rollout.play(rows, checked, jobs, naming_episodes):
        with naming_episodes([ended.job]):
            finished = _finished(ended, checked.reports()[ended.row], agent.spec.name)
        yield finished


class _CheckedAgent:
    """An agent whose answers are checked; observers of the rows learn what it is doing."""

    def __init__(self, agent: Agent, rows: TellingRows) -> None:
        self._agent, self._rows = agent, rows

    def reset(self, mask: Tensor, seeds: Sequence[int]) -> None:
        """See `Agent`."""
        self._agent.reset(mask, seeds)
        self._tell()

    def act(self, obs: Any) -> Tensor:
        """See `Agent`."""
        actions = check_actions(self._agent.act(obs), self._rows.count)
        self._tell()
        return actions

    def reports(self) -> Sequence[AgentReport]:
        """Returns a report per row."""
        return check_reports(self._agent.report(), self._rows.count, self._agent.spec.name)

    def _tell(self) -> None:
        if self._rows.watched:
            self._rows.doing = [report.doing for report in self.reports()]


def _finished(ended: Ended, report: AgentReport, name: str) -> FinishedEpisode:
    """Merges the agent's report into the environment's result."""
    said, timings_s = check_report(report, name)
    result = result_of(ended.job, ended.outcome)
    failure = None if result.success else result.failure or said or TIMEOUT
    result = replace(result, failure=failure)
    finished = FinishedEpisode(episode=result, timings_s=timings_s, trace=tuple(report.trace))
    check_finished(finished, "The result")
    return finished
