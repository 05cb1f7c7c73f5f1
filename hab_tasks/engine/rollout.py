"""The episode loop: an agent acts in N rows, and each row plays one episode after another.

Whatever plays episodes calls `play`; observers of the rows see them. PPO's collector is the only
other loop: its rollouts end after a number of steps, in the middle of episodes.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Protocol

import gymnasium as gym
import numpy as np
import torch
from torch import Tensor

UNNAMED_FAILURE = "environment"


class EndRolloutError(Exception):
    """Raised by an agent to end the rollout at once; the running episodes have no outcome."""


class Job(NamedTuple):
    """An episode to be played.

    Attributes:
        index: Its index in the set.
        episode: The `Episode`; None for one that the environment chooses.
        seed: Seed of the agent.
    """

    index: int
    episode: Any = None
    seed: int = 0


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What came of an episode, from the environment alone.

    Attributes:
        success: Whether the episode ended in success.
        stages: Whether each stage of a task was reached; {} for a skill.
        steps: Control steps taken.
        failure: The environment's failure category, None if it names none.
        episode_return: Undiscounted sum of rewards.
        scores: The environment's scores, see `HabEnv.score_names`.
        seconds: Wall time of agent and simulator [s], without resets and observers.
    """

    success: bool
    stages: dict[str, bool]
    steps: int
    failure: str | None
    episode_return: float
    scores: dict[str, float] = field(default_factory=dict)
    seconds: float = 0.0

    @classmethod
    def of(cls, info: Mapping[str, Any], row: int, **counted: Any) -> Outcome:
        """Returns the outcome that `info` has of a row; `counted` are the other fields."""
        success = "success" in info and flag(info["success"], row)  # absent before the first step
        stages = {name: flag(value, row) for name, value in info.get("stages", {}).items()}
        failed = (name for name, value in info.get("failures", {}).items() if flag(value, row))
        unnamed = UNNAMED_FAILURE if "fail" in info and flag(info["fail"], row) else None
        failure = None if success else next(failed, unnamed)
        return cls(success=success, stages=stages, failure=failure, **counted)


class Ended(NamedTuple):
    """An episode that is over, and the row that played it."""

    row: int
    job: Job
    outcome: Outcome


@dataclass(frozen=True, kw_only=True)
class StepInfo:
    """State of an episode after a reset or a step.

    Attributes:
        step: Steps taken.
        obs: The observation.
        action: The last action; None after a reset.
        info: The latest `info` of the environment.
        doing: The agent's current activity (`AgentReport.doing`).
        reward: Reward of the last step.
        episode_return: Sum of the rewards so far.
    """

    step: int
    obs: Any
    action: Any
    info: Mapping[str, Any]
    doing: str
    reward: float
    episode_return: float


class Observer(Protocol):
    """Sees the episodes of a row, in the process of its environment; must not affect them."""

    def reset(self, job: Job, seen: StepInfo) -> None:
        """Called after the reset of an episode."""

    def step(self, seen: StepInfo) -> None:
        """Called after every step."""

    def end(self, outcome: Outcome | None) -> None:
        """Called after the last step; without an outcome if the episode was not finished."""


class Actor(Protocol):
    """What a rollout calls of a `hab_tasks.agent.Agent`."""

    def reset(self, mask: Tensor, seeds: Sequence[int]) -> None:
        """See `Agent.reset`."""

    def act(self, obs: Any) -> Any:
        """See `Agent.act`; actions (N, ...) of any type that the rows take."""


class Rows(Protocol):
    """N rows, each with one episode at a time."""

    @property
    def count(self) -> int:
        """Number of rows."""
        ...

    def start(self, jobs: Mapping[int, Job]) -> None:
        """Starts episodes, by the number of the row."""

    def observe(self) -> Any:
        """Returns the observation of all rows."""

    def step(self, actions: Any, rows: Collection[int]) -> Mapping[int, Outcome]:
        """Steps some rows with their actions of (N, ...); returns the outcomes of what ended."""
        ...

    def abort(self) -> None:
        """Aborts the unfinished episodes."""


def play(
    rows: Rows,
    agent: Actor,
    jobs: Iterator[Job],
    guard: Callable[[Iterable[Job]], AbstractContextManager[object]] = nullcontext,
) -> Generator[Ended, None, None]:
    """Assigns jobs to free rows and yields episodes as they end.

    Args:
        rows: The rows.
        agent: Acts in all rows at once.
        jobs: The episodes; those of the first rows are taken at once.
        guard: Context of the agent's calls, made with the jobs that a call concerns.
    """
    playing: dict[int, Job] = {}
    seeds, act_s = [0] * rows.count, [0.0] * rows.count
    try:
        while True:
            free = (row for row in range(rows.count) if row not in playing)
            # Rows first: in the other order, `zip` would draw a job that no row is free for.
            started = dict(zip(free, jobs, strict=False))
            playing |= started
            if not playing:
                return
            for row, job in started.items():
                seeds[row], act_s[row] = job.seed, 0.0
            if started:
                with guard(started.values()):
                    agent.reset(torch.tensor([row in started for row in range(rows.count)]), seeds)
                rows.start(started)
            obs, began_s = rows.observe(), time.perf_counter()
            with guard([playing[row] for row in sorted(playing)]):
                actions = agent.act(obs)
            # The agent acts for all rows at once; each gets an equal share of its time.
            share_s = (time.perf_counter() - began_s) / len(playing)
            for row in playing:
                act_s[row] += share_s
            for row, outcome in rows.step(actions, playing).items():
                timed = replace(outcome, seconds=outcome.seconds + act_s[row])
                yield Ended(row, playing.pop(row), timed)
    except EndRolloutError:
        return
    finally:
        rows.abort()


def play_one(row: Rows, agent: Actor, job: Job) -> Outcome | None:
    """Plays an episode in a single row; returns its outcome, None if the agent ended it."""
    return next((ended.outcome for ended in play(row, agent, iter([job]))), None)


def flag(value: Any, row: int) -> bool:
    """Returns a row of an (N,) flag; Gymnasium's wrappers may return plain bools."""
    return bool(np.asarray(value).reshape(-1)[row])


Env = gym.Env[Any, Any]
Restart = Callable[[Env, Job], tuple[Any, dict[str, Any]]]


def anew(env: Env, job: Job) -> tuple[Any, dict[str, Any]]:
    """Starts an episode in a scene built anew.

    So outcomes depend neither on earlier episodes of the process nor on the number of workers.
    """
    options = {"episode": job.episode, "reconfigure": True}
    return env.reset(seed=job.episode.seed, options=options)


class EnvRow:
    """A row with an environment of its own.

    Attributes:
        job: The current or last episode; None before the first.
        doing: The agent's current activity, for the observers.
    """

    count = 1

    def __init__(
        self,
        env: Env,
        observers: Sequence[Observer] = (),
        *,
        view: Callable[[Env, Any], Any] = lambda env, obs: obs,
        restart: Restart = anew,
    ) -> None:
        """Creates a row; the agent gets the `view` of an observation, `restart` resets."""
        self.env, self.observers, self._view, self._restart = env, observers, view, restart
        self.job: Job | None = None
        self.doing, self._running = "", False
        self._obs: Any = None
        self._info: Mapping[str, Any] = {}
        self._steps, self._return, self._seconds = 0, 0.0, 0.0

    def start(self, jobs: Mapping[int, Job]) -> None:
        """See `Rows`."""
        obs, self._info = self._restart(self.env, jobs[0])
        self.job, self._running = jobs[0], True
        self._steps, self._return = 0, 0.0
        for observer in self.observers:
            observer.reset(self.job, self._seen(obs, None, 0.0))
        began_s = time.perf_counter()
        self._obs = self._view(self.env, obs)
        self._seconds = time.perf_counter() - began_s

    def observe(self) -> Any:
        """See `Rows`."""
        return self._obs

    def step(self, actions: Any, rows: Collection[int] = (0,)) -> dict[int, Outcome]:
        """See `Rows`."""
        began_s = time.perf_counter()
        obs, reward, terminated, truncated, self._info = self.env.step(actions)
        self._obs = self._view(self.env, obs)
        self._seconds += time.perf_counter() - began_s
        value = float(np.asarray(reward).reshape(-1)[0])
        self._steps += 1
        self._return += value
        for observer in self.observers:
            # What the environment returned, and not the agent's view of it.
            observer.step(self._seen(obs, actions, value))
        if not (bool(terminated) or bool(truncated)):
            return {}
        outcome = self.outcome()
        self._end(outcome)
        return {0: outcome}

    def outcome(self) -> Outcome:
        """Returns the outcome of the episode so far."""
        measures = self._info.get("measures", {})  # absent before the first step
        names = getattr(self.env.unwrapped, "score_names", ())
        return Outcome.of(
            self._info,
            0,
            steps=self._steps,
            episode_return=self._return,
            scores={n: float(measures[n].reshape(-1)[0]) for n in names if n in measures},
            seconds=self._seconds,
        )

    def abort(self) -> None:
        """See `Rows`."""
        if self._running:
            self._end(None)

    def _end(self, outcome: Outcome | None) -> None:
        self._running = False
        for observer in self.observers:
            observer.end(outcome)

    def _seen(self, obs: Any, action: Any, reward: float) -> StepInfo:
        return StepInfo(
            step=self._steps,
            obs=obs,
            action=action,
            info=self._info,
            doing=self.doing,
            reward=reward,
            episode_return=self._return,
        )
