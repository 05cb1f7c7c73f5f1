"""Environments that play one episode each, in this process; observers watch them."""

from __future__ import annotations

import gc
import time
import traceback
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import torch
from torch import Tensor

from hab_eval import environments
from hab_eval.agent_checks import without_exit
from hab_eval.config import EvalConfig
from hab_eval.errors import RunStoppedError
from hab_eval.moment import Moment
from hab_eval.observers import Observer, VideoRecorder
from hab_eval.results import EpisodeResult
from hab_eval.seen import Seen, show
from hab_tasks.agent import AgentSpec

if TYPE_CHECKING:
    import gymnasium as gym

    from hab_tasks.episodes import Episode

Job = tuple[int, "Episode"]
"""An episode with its number in the set."""

UNNAMED_FAILURE = "environment"


@dataclass(frozen=True, kw_only=True)
class RolloutPlan:
    """What a process that runs episodes needs to know; sent to the workers.

    Attributes:
        config: The evaluation.
        split: Resolved split.
        out: The run's folder, for videos.
        videos: The first so many episodes are recorded.
        device: Where the agent's networks run.
    """

    config: EvalConfig
    split: str
    out: Path
    videos: int
    device: str = "cpu"


@dataclass(frozen=True, kw_only=True)
class Start:
    """Asks a row to start an episode. `doing` is what the agent says that it is doing."""

    job: Job
    doing: str


@dataclass(frozen=True, kw_only=True)
class Step:
    """Asks a row to carry out an action (1, A)."""

    action: Tensor
    doing: str


Call = Start | Step


@dataclass(frozen=True, kw_only=True)
class Turn:
    """A row's answer to a call.

    Attributes:
        obs: Its observation.
        result: How the episode went, when it is over. The agent's share is not in it yet: `failure`
            is the environment's, None if it named none, and `seconds` its own.
    """

    obs: Any
    result: EpisodeResult | None = None


class Rows(Protocol):
    """Rows of a batch that live in one process."""

    @property
    def count(self) -> int:
        """Number of rows."""
        ...

    @property
    def watched(self) -> bool:
        """Whether observers want to know what the agent is doing."""
        ...

    def send(self, calls: Mapping[int, Call]) -> None:
        """Takes a call for some of the rows, by number within this process."""
        ...

    def receive(self) -> dict[int, Turn]:
        """Returns the answers to the last calls.

        Raises:
            RunStoppedError: If an environment raised; names the episode.
        """
        ...

    def abort(self) -> None:
        """Gives up the episodes that are not finished."""
        ...


@dataclass(kw_only=True)
class _Row:
    """An environment and the episode it plays."""

    env: gym.Env[Any, Any]
    observers: Sequence[Observer]
    episode: Episode | None = None
    steps: int = 0
    episode_return: float = 0.0
    seconds: float = 0.0
    seen: Any = None
    info: Mapping[str, Any] = field(default_factory=dict)
    result: EpisodeResult | None = None


@dataclass(kw_only=True)
class LocalRows:
    """Rows in this process, played in turn."""

    spec: AgentSpec
    rows: list[_Row] = field(default_factory=list)
    _calls: Mapping[int, Call] = field(default_factory=dict)

    def add(self, env: gym.Env[Any, Any], observers: Sequence[Observer] = ()) -> None:
        """Adds a row."""
        self.rows.append(_Row(env=env, observers=observers))

    @property
    def count(self) -> int:
        """Number of rows."""
        return len(self.rows)

    @property
    def watched(self) -> bool:
        """Whether any row has observers."""
        return any(row.observers for row in self.rows)

    def send(self, calls: Mapping[int, Call]) -> None:
        """Keeps the calls."""
        self._calls = calls

    def receive(self) -> dict[int, Turn]:
        """Carries out the calls."""
        return {number: self._turn(self.rows[number], c) for number, c in self._calls.items()}

    def so_far(self) -> EpisodeResult | None:
        """Returns how the episode of the only row has gone until now; None before the first."""
        (row,) = self.rows
        return row.result if row.episode is None else _result(row, row.info)

    def abort(self) -> None:
        """Removes unfinished videos."""
        for row in self.rows:
            if row.episode is not None:
                for observer in row.observers:
                    observer.abort()
                row.episode = None

    def close(self) -> None:
        """Frees the simulators."""
        self.abort()
        for row in self.rows:
            row.env.close()
        gc.unfreeze()  # what is never looked at counts as leaked when Python ends

    def _turn(self, row: _Row, call: Call) -> Turn:
        if isinstance(call, Start):
            row.episode = call.job[1]
        assert row.episode is not None
        try:
            with without_exit():  # images on demand may run the agent's own code
                return self._start(row, call) if isinstance(call, Start) else self._step(row, call)
        except Exception as error:
            raise stopped([row.episode], error) from error

    def _start(self, row: _Row, call: Start) -> Turn:
        """Starts an episode.

        The scene is rebuilt for every episode, so that an outcome depends neither on the episodes
        that ran before in the same process nor on the number of workers.
        """
        index, episode = call.job
        row.steps, row.episode_return, row.result = 0, 0.0, None
        options = {"episode": episode, "reconfigure": True}
        obs, row.info = row.env.reset(seed=episode.seed, options=options)
        moment = _moment(row, row.info, call.doing, 0.0)
        for observer in row.observers:
            observer.start(index, episode, moment)
        started = time.perf_counter()
        row.seen = show(row.env, self.spec, obs)
        row.seconds = time.perf_counter() - started
        return Turn(obs=row.seen)

    def _step(self, row: _Row, call: Step) -> Turn:
        """Carries out an action; the environment says whether the episode is over."""
        started = time.perf_counter()
        if isinstance(row.seen, Seen):
            row.seen.step_away()
        obs, reward, terminated, truncated, row.info = row.env.step(call.action)
        row.seen = show(row.env, self.spec, obs)
        row.seconds += time.perf_counter() - started
        paid = float(torch.as_tensor(reward).reshape(-1)[0])
        row.steps += 1
        row.episode_return += paid
        for observer in row.observers:
            observer.step(_moment(row, row.info, call.doing, paid))
        over = _first(terminated) or _first(truncated)
        row.result = _result(row, row.info) if over else None
        if over:
            for observer in row.observers:
                observer.end()
            row.episode = None
        return Turn(obs=row.seen, result=row.result)


def make_rows(plan: RolloutPlan, spec: AgentSpec, count: int) -> LocalRows:
    """Makes the environments of `count` rows in this process."""
    # ManiSkill collects garbage whenever it builds a scene, which is before each episode:
    # looking through all that was imported would take most of a reset.
    gc.freeze()
    rows = LocalRows(spec=spec)
    for _ in range(count):
        render = plan.videos > 0
        env = environments.make_env(plan.config, spec, split=plan.split, render=render)
        instruct = partial(environments.instruction_of, plan.config.env)
        film = VideoRecorder(env, plan.out, count=plan.videos, instruct=instruct)
        rows.add(env, [film] if render else [])
    return rows


def stopped(episodes: Iterable[Episode], error: Exception) -> RunStoppedError:
    """Returns the error that names the episodes that an exception ended."""
    ids = ", ".join(repr(episode.id) for episode in episodes)
    which = "Episodes" if ", " in ids else "Episode"
    return RunStoppedError(
        f"{which} {ids} stopped the run: {type(error).__name__}: {error}",
        details="".join(traceback.format_exception(error)),
    )


def _moment(row: _Row, info: Mapping[str, Any], doing: str, reward: float) -> Moment:
    """Returns what observers are told."""
    return Moment(
        step=row.steps, info=info, doing=doing, reward=reward, episode_return=row.episode_return
    )


def _result(row: _Row, info: Mapping[str, Any]) -> EpisodeResult:
    """Returns how an episode went, from the environment's point of view."""
    assert row.episode is not None
    success = _first(info.get("success", False))  # nothing is known of it before the first step
    return EpisodeResult(
        id=row.episode.id,
        scene=row.episode.scene_id,
        success=success,
        stages={name: _first(value) for name, value in info.get("stages", {}).items()},
        steps=row.steps,
        failure=None if success else _failure(info),
        episode_return=row.episode_return,
        seconds=row.seconds,
    )


def _failure(info: Mapping[str, Any]) -> str | None:
    """Names why an episode failed, if the environment knows."""
    named = [name for name, value in info.get("failures", {}).items() if _first(value)]
    if named:
        return named[0]
    return UNNAMED_FAILURE if _first(info.get("fail", False)) else None


def _first(value: Any) -> bool:
    """Returns the only row of an (N,) flag; Gymnasium's own wrappers may return plain bools."""
    return bool(torch.as_tensor(value).reshape(-1)[0])
