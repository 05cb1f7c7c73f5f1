"""A single environment as a row of a rollout."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np

from hab_tasks.engine.rollout import Job, Observer, Outcome, StepInfo

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
        count: Number of rows.
        env: The environment.
        observers: What sees its episodes.
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
