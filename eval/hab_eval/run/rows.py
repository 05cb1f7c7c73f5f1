"""Batch rows in this process: each is an environment that runs one episode at a time."""

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

from hab_eval.records.config import EvalConfig
from hab_eval.records.results import EpisodeResult
from hab_eval.run import environments
from hab_eval.run.agent_checks import without_exit
from hab_eval.run.film import StepInfo
from hab_eval.run.observations import LazyObservation, agent_view
from hab_eval.run.observers import Observer, VideoRecorder
from hab_tasks.agent import AgentSpec
from hab_tasks.errors import RunStoppedError

if TYPE_CHECKING:
    import gymnasium as gym

    from hab_tasks.episodes import Episode

Job = tuple[int, "Episode"]
"""An episode with its index in the set."""

UNNAMED_FAILURE = "environment"


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
        result: Result of the episode if it is over, from the environment alone: `failure` is the
            environment's category or None, and `seconds` does not include the agent.
    """

    obs: Any
    result: EpisodeResult | None = None


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
class _Row:
    """An environment and its current episode."""

    env: gym.Env[Any, Any]
    observers: Sequence[Observer]
    episode: Episode | None = None
    steps: int = 0
    episode_return: float = 0.0
    seconds: float = 0.0
    obs: Any = None
    info: Mapping[str, Any] = field(default_factory=dict)
    result: EpisodeResult | None = None


@dataclass(kw_only=True)
class LocalRows:
    """Batch rows in this process, stepped one after another."""

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
        """Stores the calls."""
        self._calls = calls

    def receive(self) -> dict[int, Turn]:
        """Executes the calls."""
        return {number: self._turn(self.rows[number], c) for number, c in self._calls.items()}

    def partial_result(self) -> EpisodeResult | None:
        """Returns the preliminary result of the only row's episode; None before the first."""
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
        gc.unfreeze()  # frozen objects count as leaked when Python ends

    def _turn(self, row: _Row, call: Call) -> Turn:
        if isinstance(call, Start):
            row.episode = call.job[1]
        assert row.episode is not None
        try:
            with without_exit():  # rendering on demand may run the agent's own code
                return self._start(row, call) if isinstance(call, Start) else self._step(row, call)
        except Exception as error:
            raise episode_error([row.episode], error) from error

    def _start(self, row: _Row, call: Start) -> Turn:
        """Starts an episode.

        The scene is rebuilt for every episode, so that outcomes depend neither on the earlier
        episodes of the process nor on the number of workers.
        """
        index, episode = call.job
        row.steps, row.episode_return, row.result = 0, 0.0, None
        options = {"episode": episode, "reconfigure": True}
        obs, row.info = row.env.reset(seed=episode.seed, options=options)
        step_info = _step_info(row, row.info, call.doing, 0.0)
        for observer in row.observers:
            observer.start(index, episode, step_info)
        started = time.perf_counter()
        row.obs = agent_view(row.env, self.spec, obs)
        row.seconds = time.perf_counter() - started
        return Turn(obs=row.obs)

    def _step(self, row: _Row, call: Step) -> Turn:
        """Steps the environment; returns the result if the episode is over."""
        started = time.perf_counter()
        if isinstance(row.obs, LazyObservation):
            row.obs.expire()
        obs, reward, terminated, truncated, row.info = row.env.step(call.action)
        row.obs = agent_view(row.env, self.spec, obs)
        row.seconds += time.perf_counter() - started
        value = float(torch.as_tensor(reward).reshape(-1)[0])
        row.steps += 1
        row.episode_return += value
        for observer in row.observers:
            observer.step(_step_info(row, row.info, call.doing, value))
        over = _first(terminated) or _first(truncated)
        row.result = _result(row, row.info) if over else None
        if over:
            for observer in row.observers:
                observer.end()
            row.episode = None
        return Turn(obs=row.obs, result=row.result)


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


def _step_info(row: _Row, info: Mapping[str, Any], doing: str, reward: float) -> StepInfo:
    """Returns the information for observers."""
    return StepInfo(
        step=row.steps, info=info, doing=doing, reward=reward, episode_return=row.episode_return
    )


def _result(row: _Row, info: Mapping[str, Any]) -> EpisodeResult:
    """Returns the result of an episode, from the environment alone."""
    assert row.episode is not None
    success = _first(info.get("success", False))  # absent before the first step
    return EpisodeResult(
        id=row.episode.id,
        scene=row.episode.scene_id,
        success=success,
        stages={name: _first(value) for name, value in info.get("stages", {}).items()},
        steps=row.steps,
        failure=None if success else _failure(info),
        episode_return=row.episode_return,
        scores=_scores(row.env, info),
        seconds=row.seconds,
    )


def _scores(env: gym.Env[Any, Any], info: Mapping[str, Any]) -> dict[str, float]:
    """Returns the environment's scores; {} before the first step."""
    measures = info.get("measures", {})
    names = getattr(env.unwrapped, "score_names", ())
    return {name: float(measures[name].reshape(-1)[0]) for name in names if name in measures}


def _failure(info: Mapping[str, Any]) -> str | None:
    """Returns the environment's failure category, None if there is none."""
    named = [name for name, value in info.get("failures", {}).items() if _first(value)]
    if named:
        return named[0]
    return UNNAMED_FAILURE if _first(info.get("fail", False)) else None


def _first(value: Any) -> bool:
    """Returns the only row of an (N,) flag; Gymnasium's wrappers may return plain bools."""
    return bool(torch.as_tensor(value).reshape(-1)[0])
