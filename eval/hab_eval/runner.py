"""The one rollout loop. Recording and video are observers; parallel runs call it in each worker."""

from __future__ import annotations

import gc
import json
import time
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from hab_eval import environments
from hab_eval.config import EvalConfig
from hab_eval.errors import AgentError, RunStoppedError
from hab_eval.load_agent import load_agent
from hab_eval.moment import Moment
from hab_eval.observers import Observer, VideoRecorder
from hab_eval.results import EpisodeResult, FinishedEpisode
from hab_eval.seen import Seen, show
from hab_tasks.agent import Agent, AgentReport, AgentSetup
from hab_tasks.processes import use_one_thread

if TYPE_CHECKING:
    import gymnasium as gym

    from hab_tasks.episodes import Episode

TIMEOUT = "timeout"
UNNAMED_FAILURE = "environment"


@dataclass(frozen=True, kw_only=True)
class RolloutPlan:
    """What a process that runs episodes has to know; sent to the workers.

    Attributes:
        config: The evaluation.
        split: Resolved split.
        out: The run's folder, for videos.
        videos: The first so many episodes are recorded.
    """

    config: EvalConfig
    split: str
    out: Path
    videos: int


class Rollouts:
    """An environment with the agent that acts in it."""

    def __init__(self, plan: RolloutPlan) -> None:
        use_one_thread()
        config = plan.config
        setup = AgentSetup(env_id=config.env, seed=config.seed, options=config.options)
        self._agent = load_agent(config.agent, setup)
        # ManiSkill collects garbage whenever it builds a scene, which is before each episode:
        # looking through all that was imported would take most of a reset.
        gc.freeze()
        self._env = environments.make_env(
            config, self._agent.spec, split=plan.split, render=plan.videos > 0
        )
        self._observers: list[Observer] = []
        if plan.videos:
            self._observers.append(VideoRecorder(self._env, plan.out, count=plan.videos))

    def run(self, index: int, episode: Episode) -> FinishedEpisode:
        """Runs episode number `index` of the set.

        Raises:
            RunStoppedError: If the agent or the environment raised; names the episode.
        """
        try:
            return run_episode(self._env, self._agent, index, episode, self._observers)
        except Exception as error:
            raise RunStoppedError(
                f"Episode {episode.id!r} stopped the run: {type(error).__name__}: {error}",
                details=traceback.format_exc(),
            ) from error

    def close(self) -> None:
        """Frees the simulator."""
        self._env.close()
        gc.unfreeze()  # what is never looked at counts as leaked when Python ends


def run_episode(
    env: gym.Env[Any, Any],
    agent: Agent,
    index: int,
    episode: Episode,
    observers: Sequence[Observer] = (),
) -> FinishedEpisode:
    """Runs one episode to its end and returns how it went.

    The scene is rebuilt for every episode, so that an outcome depends neither on the episodes that
    ran before in the same process nor on the number of workers.
    """
    obs, info = env.reset(seed=episode.seed, options={"episode": episode, "reconfigure": True})
    agent.reset(torch.ones(1, dtype=torch.bool), [episode.seed])
    try:
        for observer in observers:
            observer.start(index, episode, _moment(agent, info, 0, 0.0, 0.0))
        finished = _rollout(env, agent, episode, obs, observers)
    except BaseException:
        for observer in observers:
            observer.abort()
        raise
    for observer in observers:
        observer.end()
    return finished


def _rollout(
    env: gym.Env[Any, Any],
    agent: Agent,
    episode: Episode,
    obs: Mapping[str, Any],
    observers: Sequence[Observer],
) -> FinishedEpisode:
    """Steps until the environment says that the episode is over."""
    steps, episode_return, seconds, done = 0, 0.0, 0.0, False
    info: Mapping[str, Any] = {}
    while not done:
        started = time.perf_counter()
        seen = show(env, agent.spec, obs)
        action = agent.act(seen)
        _check_action(action)
        if isinstance(seen, Seen):
            seen.step_away()
        obs, reward, terminated, truncated, info = env.step(action)
        seconds += time.perf_counter() - started
        steps += 1
        paid = float(torch.as_tensor(reward).reshape(-1)[0])
        episode_return += paid
        done = _first(terminated) or _first(truncated)
        for observer in observers:
            observer.step(_moment(agent, info, steps, paid, episode_return))
    report = agent.report()[0]
    success = _first(info["success"])
    result = EpisodeResult(
        id=episode.id,
        scene=episode.scene_id,
        success=success,
        stages={name: _first(value) for name, value in info.get("stages", {}).items()},
        steps=steps,
        failure=None if success else _failure(info, report.failure),
        episode_return=episode_return,
        seconds=seconds,
    )
    timings_s = {name: float(value) for name, value in report.timings_s.items()}
    return FinishedEpisode(episode=result, timings_s=timings_s, trace=_checked_trace(report))


def _moment(
    agent: Agent, info: Mapping[str, Any], step: int, reward: float, episode_return: float
) -> Moment:
    """Returns what observers are told."""
    return Moment(
        step=step,
        info=info,
        doing=agent.report()[0].doing,
        reward=reward,
        episode_return=episode_return,
    )


def _failure(info: Mapping[str, Any], reported: str | None) -> str:
    """Names why an episode failed: the environment's word first, then the agent's own."""
    named = [name for name, value in info.get("failures", {}).items() if _first(value)]
    if named:
        return named[0]
    if _first(info.get("fail", False)):
        return UNNAMED_FAILURE
    return reported or TIMEOUT


def _checked_trace(report: AgentReport) -> tuple[dict[str, Any], ...]:
    """Returns the trace; refuses here, where the episode is named, what cannot be written."""
    try:
        json.dumps(report.trace, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise AgentError(
            f"The trace in report() holds what JSON does not know: {error}."
        ) from error
    return report.trace


def _check_action(action: object) -> None:
    """Refuses what is no (1, A) tensor, in words; the environment checks the numbers."""
    if not isinstance(action, Tensor) or action.ndim != 2 or action.shape[0] != 1:
        found = tuple(action.shape) if isinstance(action, Tensor) else type(action).__name__
        raise AgentError(f"act() must return a (1, A) tensor for one row, got {found}.")


def _first(value: Any) -> bool:
    """Returns the only row of an (N,) flag; Gymnasium's own wrappers may return plain bools."""
    return bool(torch.as_tensor(value).reshape(-1)[0])
