"""The rollout loop: an agent acts in N batch rows, each running one episode after another.

N is 1 for most agents. Videos are recorded by observers of the rows. Rows are in this process
(`hab_eval.run.rows`) or in workers (`hab_eval.run.workers`), behind the same interface.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import torch

from hab_eval.records.results import FinishedEpisode, check_finished
from hab_eval.run.agent_checks import check_actions, check_report, check_reports, without_exit
from hab_eval.run.environments import agent_seed
from hab_eval.run.observations import batched
from hab_eval.run.observers import Observer
from hab_eval.run.rows import Call, Job, LocalRows, RowGroup, Start, Step, Turn, episode_error
from hab_tasks.agent import Agent
from hab_tasks.errors import RunStoppedError

if TYPE_CHECKING:
    import gymnasium as gym

    from hab_tasks.episodes import Episode

TIMEOUT = "timeout"


@dataclass(kw_only=True)
class _RowState:
    """State of a row in the loop; `episode` is None when the row is free."""

    episode: Episode | None = None
    seed: int = 0
    obs: Any = None
    act_s: float = 0.0


def run_episode(
    env: gym.Env[Any, Any],
    agent: Agent,
    index: int,
    episode: Episode,
    observers: Sequence[Observer] = (),
) -> FinishedEpisode:
    """Runs one episode in a given environment and returns its result.

    Raises:
        Exception: Raised by the agent or the environment.
    """
    rows = LocalRows(spec=agent.spec)
    rows.add(env, observers)
    try:
        (finished,) = play(agent, [rows], iter([(index, episode)]))
    except RunStoppedError as error:
        raise error.__cause__ or error from None
    return finished


def play(
    agent: Agent, groups: Sequence[RowGroup], jobs: Iterator[Job]
) -> Generator[FinishedEpisode, None, None]:
    """Assigns jobs to free rows and yields results as episodes finish.

    There must be at least as many jobs as rows.

    Raises:
        RunStoppedError: The agent or an environment raised; the message has the episodes.
    """
    rows = [_RowState() for group in groups for _ in range(group.count)]
    watched = any(group.watched for group in groups)
    try:
        while calls := _next_calls(agent, rows, jobs, watched):
            for number, turn in _exchange(groups, calls).items():
                rows[number].obs = turn.obs
                if turn.result is not None:
                    yield _finish(agent, rows, number, turn)
    finally:
        for group in groups:
            group.abort()


def _next_calls(
    agent: Agent, rows: Sequence[_RowState], jobs: Iterator[Job], watched: bool
) -> dict[int, Call]:
    """Returns an action for every running row and a new episode for every free row."""
    playing = [number for number, row in enumerate(rows) if row.episode is not None]
    calls: dict[int, Call] = dict(_act(agent, rows, playing, watched)) if playing else {}
    started: dict[int, Job] = {}
    for number, row in enumerate(rows):
        job = next(jobs, None) if row.episode is None else None
        if job is not None:
            started[number] = job
            row.episode, row.seed, row.act_s = job[1], agent_seed(job[1].seed), 0.0
    if started:
        mask = torch.tensor([number in started for number in range(len(rows))])
        with _naming_episodes(job[1] for job in started.values()):
            agent.reset(mask, [row.seed for row in rows])
            doing = _doing(agent, rows, watched)
        for number, job in started.items():
            calls[number] = Start(job=job, doing=doing[number])
    return calls


def _act(
    agent: Agent, rows: Sequence[_RowState], playing: Sequence[int], watched: bool
) -> dict[int, Step]:
    """Queries the agent's actions for all rows; returns those of the running rows."""
    started = time.perf_counter()
    with _naming_episodes(_episodes(rows)):
        actions = check_actions(agent.act(batched([row.obs for row in rows])), len(rows))
        seconds = (time.perf_counter() - started) / len(playing)
        doing = _doing(agent, rows, watched)
    for number in playing:
        rows[number].act_s += seconds
    return {n: Step(action=actions[n : n + 1], doing=doing[n]) for n in playing}


def _doing(agent: Agent, rows: Sequence[_RowState], watched: bool) -> list[str]:
    """Returns the agent's current activity in each row; empty if no observer needs it."""
    if not watched:
        return [""] * len(rows)
    return [one.doing for one in check_reports(agent.report(), len(rows), agent.spec.name)]


def _exchange(groups: Sequence[RowGroup], calls: Mapping[int, Call]) -> dict[int, Turn]:
    """Sends each group the calls of its rows, then collects the answers."""
    first, sent = 0, []
    for group in groups:
        own = {n - first: call for n, call in calls.items() if 0 <= n - first < group.count}
        if own:
            group.send(own)
            sent.append((first, group))
        first += group.count
    return {start + n: turn for start, group in sent for n, turn in group.receive().items()}


def _finish(agent: Agent, rows: Sequence[_RowState], number: int, turn: Turn) -> FinishedEpisode:
    """Merges the agent's report into the environment's result and frees the row."""
    assert turn.result is not None
    row, name = rows[number], agent.spec.name
    with _naming_episodes(_episodes([row])):
        report = check_reports(agent.report(), len(rows), name)[number]
        said, timings_s = check_report(report, name)
        failure = None if turn.result.success else turn.result.failure or said or TIMEOUT
        result = replace(turn.result, failure=failure, seconds=turn.result.seconds + row.act_s)
        finished = FinishedEpisode(episode=result, timings_s=timings_s, trace=tuple(report.trace))
        check_finished(finished, "The result")
    row.episode = None
    return finished


@contextlib.contextmanager
def _naming_episodes(episodes: Iterable[Episode]) -> Generator[None, None, None]:
    """Converts exceptions of the agent into errors that name the episodes."""
    try:
        with without_exit():
            yield
    except Exception as error:
        raise episode_error(episodes, error) from error


def _episodes(rows: Sequence[_RowState]) -> Iterator[Episode]:
    return (row.episode for row in rows if row.episode is not None)
