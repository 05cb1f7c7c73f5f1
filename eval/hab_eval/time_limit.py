"""Time limit for an agent's calls: the messages of a worker to its parent.

A call that hangs, perhaps inside a library, cannot be interrupted from within its process. The
worker therefore announces every call, with the preliminary result of the episode, and the parent
kills the process when the call exceeds the limit.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from torch import Tensor

from hab_eval.results import AGENT_TIMEOUT, EpisodeResult, FinishedEpisode
from hab_tasks.agent import Agent, AgentReport

if TYPE_CHECKING:
    from hab_eval.rows import LocalRows
    from hab_tasks.episodes import Episode


@dataclass(frozen=True, kw_only=True)
class CallStarted:
    """Message: a call of the agent starts.

    Attributes:
        at_s: Start time on the machine's monotonic clock, shared by all processes [s].
        agent_s: Time of the agent's earlier calls in this episode [s].
        partial_result: Preliminary result of the episode; None before its first step.
    """

    at_s: float
    agent_s: float = 0.0
    partial_result: EpisodeResult | None = None

    def timed_out(self, now_s: float, episode: Episode) -> FinishedEpisode:
        """Returns the result of the episode if this call exceeds the time limit.

        Args:
            now_s: Current time [s].
            episode: The current episode.
        """
        known = self.partial_result or EpisodeResult(
            id=episode.id,
            scene=episode.scene_id,
            success=False,
            stages={},
            steps=0,
            failure=AGENT_TIMEOUT,
            episode_return=0.0,
            seconds=0.0,
        )
        seconds = known.seconds + self.agent_s + now_s - self.at_s
        result = replace(known, success=False, failure=AGENT_TIMEOUT, seconds=seconds)
        return FinishedEpisode(episode=result, timings_s={})


@dataclass(frozen=True, kw_only=True)
class CallEnded:
    """Message: the call of the agent has ended, at this time [s]."""

    at_s: float


class TimedAgent:
    """Wraps an agent of one row and announces each of its calls."""

    def __init__(
        self, agent: Agent, rows: LocalRows, send: Callable[[CallStarted | CallEnded], None]
    ) -> None:
        """Announces the calls of `agent`, which acts in `rows`, by `send`."""
        self.spec = agent.spec
        self._agent, self._rows, self._send = agent, rows, send
        self._agent_s = 0.0

    def reset(self, mask: Tensor, seeds: Sequence[int]) -> None:
        """Starts an episode."""
        self._agent_s = 0.0
        with self._announced(None):
            self._agent.reset(mask, seeds)

    def act(self, obs: Mapping[str, Any]) -> Tensor:
        """Returns the agent's actions (1, A)."""
        with self._announced(self._rows.partial_result()):
            return self._agent.act(obs)

    def report(self) -> list[AgentReport]:
        """Returns the agent's report."""
        with self._announced(self._rows.partial_result()):
            return self._agent.report()

    @contextlib.contextmanager
    def _announced(self, partial_result: EpisodeResult | None) -> Generator[None, None, None]:
        call = CallStarted(
            at_s=time.monotonic(), agent_s=self._agent_s, partial_result=partial_result
        )
        self._send(call)
        try:
            yield
        finally:
            now_s = time.monotonic()
            self._agent_s += now_s - call.at_s
            self._send(CallEnded(at_s=now_s))
