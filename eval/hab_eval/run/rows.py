"""Batch rows: each is an environment that runs one episode at a time, here or in workers."""

from __future__ import annotations

import contextlib
import gc
import traceback
from collections.abc import Collection, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from torch import Tensor

from hab_eval.records.config import EvalConfig
from hab_eval.records.results import EpisodeResult
from hab_eval.run import environments
from hab_eval.run.agent_checks import without_exit
from hab_eval.run.observations import AgentView, batched
from hab_eval.run.observers import VideoRecorder
from hab_tasks.agent import AgentSpec
from hab_tasks.engine.env_row import EnvRow
from hab_tasks.engine.rollout import Job, Observer, Outcome
from hab_tasks.errors import RunStoppedError

if TYPE_CHECKING:
    import gymnasium as gym

    from hab_tasks.episodes import Episode


@dataclass(frozen=True, kw_only=True)
class RolloutPlan:
    """Settings of a process that runs episodes; sent to the workers.

    Attributes:
        config: The evaluation's configuration.
        split: Resolved episode split.
        out: The run folder, for videos.
        videos: Number of episodes to record, from the first.
        device: Device of the agent's networks.
    """

    config: EvalConfig
    split: str
    out: Path
    videos: int
    device: str = "cpu"


@dataclass(frozen=True, kw_only=True)
class Start:
    """Request to start an episode in a row; `doing` is the agent's current activity."""

    job: Job
    doing: str


@dataclass(frozen=True, kw_only=True)
class Step:
    """Request to step a row with an action (1, A); `doing` is the agent's current activity."""

    action: Tensor
    doing: str


Call = Start | Step


@dataclass(frozen=True, kw_only=True)
class Turn:
    """A row's answer to a call.

    Attributes:
        obs: Observation.
        result: Outcome of the episode if it is over; its `seconds` do not include the agent.
    """

    obs: Any
    result: Outcome | None = None


class RowGroup(Protocol):
    """Batch rows in one process."""

    @property
    def count(self) -> int:
        """Number of rows."""
        ...

    @property
    def watched(self) -> bool:
        """Whether observers need the agent's current activity."""
        ...

    def send(self, calls: Mapping[int, Call]) -> None:
        """Sends calls to some of the rows, by their number within this group."""
        ...

    def receive(self) -> dict[int, Turn]:
        """Returns the answers to the last calls.

        Raises:
            RunStoppedError: An environment raised; the message has the episode.
        """
        ...

    def abort(self) -> None:
        """Aborts the unfinished episodes."""
        ...


@dataclass(kw_only=True)
class LocalRows:
    """Batch rows in this process, stepped one after another."""

    spec: AgentSpec
    rows: list[EnvRow] = field(default_factory=list)
    _calls: Mapping[int, Call] = field(default_factory=dict)

    def add(self, env: gym.Env[Any, Any], observers: Sequence[Observer] = ()) -> None:
        """Adds a row."""
        self.rows.append(EnvRow(env, observers, view=AgentView(self.spec)))

    @property
    def count(self) -> int:
        """Number of rows."""
        return len(self.rows)

    @property
    def watched(self) -> bool:
        """Whether any row has observers."""
        return any(row.observers for row in self.rows)

    def send(self, calls: Mapping[int, Call]) -> None:
        """Stores the calls."""
        self._calls = calls

    def receive(self) -> dict[int, Turn]:
        """Executes the calls."""
        return {number: _turn(self.rows[number], call) for number, call in self._calls.items()}

    def partial_result(self) -> EpisodeResult | None:
        """Returns the preliminary result of the only row's episode; None before the first."""
        (row,) = self.rows
        return None if row.job is None else result_of(row.job, row.outcome())

    def abort(self) -> None:
        """Removes unfinished videos."""
        for row in self.rows:
            row.abort()

    def close(self) -> None:
        """Frees the simulators."""
        self.abort()
        for row in self.rows:
            row.env.close()
        gc.unfreeze()  # frozen objects count as leaked when Python ends


def _turn(row: EnvRow, call: Call) -> Turn:
    row.doing = call.doing
    job = call.job if isinstance(call, Start) else row.job
    assert job is not None
    with naming_episodes([job]):
        if isinstance(call, Start):
            row.start({0: job})
            return Turn(obs=row.observe())
        outcome = row.step(call.action).get(0)
        return Turn(obs=row.observe(), result=outcome)


class GroupedRows:
    """Rows of several groups, which work at the same time.

    Attributes:
        count: Number of rows.
        watched: Whether observers need the agent's current activity.
        doing: That activity, in each row.
    """

    def __init__(self, groups: Sequence[RowGroup]) -> None:
        """Joins groups."""
        self._groups = groups
        self.count = sum(group.count for group in groups)
        self.watched = any(group.watched for group in groups)
        self.doing, self._obs = [""] * self.count, [None] * self.count

    def start(self, jobs: Mapping[int, Job]) -> None:
        """See `Rows`."""
        self._exchange({n: Start(job=job, doing=self.doing[n]) for n, job in jobs.items()})

    def observe(self) -> Any:
        """See `Rows`."""
        return batched(self._obs)

    def step(self, actions: Tensor, rows: Collection[int]) -> dict[int, Outcome]:
        """See `Rows`."""
        calls = {n: Step(action=actions[n : n + 1], doing=self.doing[n]) for n in sorted(rows)}
        turns = self._exchange(calls)
        return {n: turn.result for n, turn in turns.items() if turn.result is not None}

    def abort(self) -> None:
        """See `Rows`."""
        for group in self._groups:
            group.abort()

    def _exchange(self, calls: Mapping[int, Call]) -> dict[int, Turn]:
        """Sends each group the calls of its rows, then collects the answers."""
        first, sent = 0, []
        for group in self._groups:
            own = {n - first: call for n, call in calls.items() if 0 <= n - first < group.count}
            if own:
                group.send(own)
                sent.append((first, group))
            first += group.count
        turns = {start + n: turn for start, group in sent for n, turn in group.receive().items()}
        for n, turn in turns.items():
            self._obs[n] = turn.obs
        return turns


def make_rows(plan: RolloutPlan, spec: AgentSpec, count: int) -> LocalRows:
    """Creates the environments of `count` rows in this process."""
    # ManiSkill collects garbage whenever it builds a scene, i.e. before each episode. Scanning all
    # imported objects would take most of a reset.
    gc.freeze()
    rows = LocalRows(spec=spec)
    for _ in range(count):
        render = plan.videos > 0
        env = environments.make_env(plan.config, spec, split=plan.split, render=render)
        instruct = partial(environments.instruction_of, plan.config.env)
        film = VideoRecorder(env, plan.out, count=plan.videos, instruct=instruct)
        rows.add(env, [film] if render else [])
    return rows


def episode_error(episodes: Iterable[Episode], error: Exception) -> RunStoppedError:
    """Returns the error for episodes that an exception ended."""
    ids = ", ".join(repr(episode.id) for episode in episodes)
    which = "Episodes" if ", " in ids else "Episode"
    return RunStoppedError(
        f"{which} {ids} stopped the run: {type(error).__name__}: {error}",
        details="".join(traceback.format_exception(error)),
    )


def job_of(index: int, episode: Episode) -> Job:
    """Returns the job of an episode; its seed does not tell the agent that of the episode."""
    return Job(index, episode, environments.agent_seed(episode.seed))


@contextlib.contextmanager
def naming_episodes(jobs: Iterable[Job]) -> Generator[None, None, None]:
    """Converts exceptions into errors that name the episodes of `jobs`.

    Raises:
        RunStoppedError: The agent or an environment raised.
    """
    try:
        with without_exit():  # also in an environment: rendering on demand may run agents' code
            yield
    except Exception as error:
        ids = ", ".join(repr(job.episode.id) for job in jobs)
        which = "Episodes" if ", " in ids else "Episode"
        raise RunStoppedError(
            f"{which} {ids} stopped the run: {type(error).__name__}: {error}",
            details="".join(traceback.format_exception(error)),
        ) from error


def result_of(job: Job, outcome: Outcome) -> EpisodeResult:
    """Returns the result of an episode, from the environment alone."""
    return EpisodeResult(id=job.episode.id, scene=job.episode.scene_id, **vars(outcome))
