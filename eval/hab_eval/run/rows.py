"""Rows of an evaluation: each is an environment that runs one episode at a time."""

from __future__ import annotations

import contextlib
import gc
import traceback
from collections.abc import Collection, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torch import Tensor

from hab_eval.records.config import EvalConfig
from hab_eval.records.results import EpisodeResult
from hab_eval.run import environments
from hab_eval.run.agent_checks import without_exit
from hab_eval.run.film import VideoRecorder
from hab_eval.run.motion import MotionRecorder
from hab_eval.run.observations import AgentView, batched
from hab_tasks.agent import AgentSpec
from hab_tasks.engine.rollout import EnvRow, Job, Observer, Outcome
from hab_tasks.errors import RunStoppedError

if TYPE_CHECKING:
    from hab_tasks.episodes import Episode


@dataclass(frozen=True, kw_only=True)
class RolloutPlan:
    """Settings of a process that runs episodes; sent to the workers.

    Attributes:
        config: The evaluation's configuration.
        split: Resolved episode split.
        out: The run folder, for videos and motions.
        videos: Number of episodes to record, from the first.
        motions: Whether to record the motion of every body, see `hab_eval.run.motion`.
        device: Device of the agent's networks.
    """

    config: EvalConfig
    split: str
    out: Path
    videos: int
    motions: bool = False
    device: str = "cpu"


class LocalRows:
    """Rows in this process, stepped one after another.

    Attributes:
        rows: The rows.
        count: Their number.
        watched: Whether any has observers, who need the agent's current activity.
        doing: That activity, by row.
    """

    def __init__(self, rows: Sequence[EnvRow]) -> None:
        """Joins rows."""
        self.rows, self.count = rows, len(rows)
        self.watched = any(row.observers for row in rows)
        self.doing = [""] * self.count

    def start(self, jobs: Mapping[int, Job]) -> None:
        """See `Rows`."""
        for number, job in jobs.items():
            self.rows[number].doing = self.doing[number]
            with naming_episodes([job]):
                self.rows[number].start({0: job})

    def observe(self) -> Any:
        """See `Rows`."""
        return batched([row.observe() for row in self.rows])

    def step(self, actions: Tensor, rows: Collection[int]) -> dict[int, Outcome]:
        """See `Rows`."""
        ended = {}
        for number in sorted(rows):
            row = self.rows[number]
            row.doing = self.doing[number]
            with naming_episodes([row.job]):
                outcome = row.step(actions[number : number + 1]).get(0)
            if outcome is not None:
                ended[number] = outcome
        return ended

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


def make_rows(plan: RolloutPlan, spec: AgentSpec, count: int) -> LocalRows:
    """Creates the environments of `count` rows in this process."""
    # ManiSkill collects garbage whenever it builds a scene, i.e. before each episode. Scanning all
    # imported objects would take most of a reset.
    gc.freeze()
    rows = []
    for _ in range(count):
        render = plan.videos > 0
        env = environments.make_env(plan.config, spec, split=plan.split, render=render)
        instruct = partial(environments.instruction_of, plan.config.env)
        film = VideoRecorder(env, plan.out, count=plan.videos, instruct=instruct)
        observers: list[Observer] = [film] if render else []
        observers += [MotionRecorder(env, plan.out)] if plan.motions else []
        rows.append(EnvRow(env, observers, view=AgentView(spec)))
    return LocalRows(rows)


def job_of(index: int, episode: Episode) -> Job:
    """Returns the job of an episode; its seed does not tell the agent that of the episode."""
    return Job(index, episode, environments.agent_seed(episode.seed))


@contextlib.contextmanager
def naming_episodes(jobs: Iterable[Job | None]) -> Generator[None, None, None]:
    """Converts exceptions into errors that name the episodes of `jobs`.

    Raises:
        RunStoppedError: The agent or an environment raised.
    """
    try:
        with without_exit():  # also in an environment: rendering on demand may run agents' code
            yield
    except Exception as error:
        ids = ", ".join(repr(job.episode.id) for job in jobs if job is not None)
        which = "Episodes" if ", " in ids else "Episode"
        raise RunStoppedError(
            f"{which} {ids} stopped the run: {type(error).__name__}: {error}",
            details="".join(traceback.format_exception(error)),
        ) from error


def result_of(job: Job, outcome: Outcome) -> EpisodeResult:
    """Returns the result of an episode, from the environment alone."""
    return EpisodeResult(id=job.episode.id, scene=job.episode.scene_id, **vars(outcome))
