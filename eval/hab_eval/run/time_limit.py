"""Time limit for an agent's calls: the messages of a worker to its parent.

A call that hangs, perhaps inside a library, cannot be interrupted from within its process. The
worker therefore announces every call, with the preliminary result of the episode, and the parent
kills the process when the call exceeds the limit.

Time in which the agent's process or the parent is stopped (SIGSTOP, Ctrl-Z) does not count.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torch import Tensor

from hab_eval.records.results import AGENT_TIMEOUT, EpisodeResult, FinishedEpisode
from hab_tasks.agent import Agent, AgentReport

if TYPE_CHECKING:
    from hab_eval.run.rows import LocalRows
    from hab_tasks.episodes import Episode

TICK_S = 0.1
"""Time between two looks at the processes [s]."""

LONGEST_TICK_S = 1.0
"""A longer time between two ticks is a stop of this process [s]."""


@dataclass(frozen=True, kw_only=True)
class CallStarted:
    """Message: a call of the agent starts.

    Attributes:
        agent_s: Time of the agent's earlier calls in this episode [s].
        partial_result: Preliminary result of the episode; None before its first step.
    """

    agent_s: float = 0.0
    partial_result: EpisodeResult | None = None

    def timed_out(self, call_s: float, episode: Episode) -> FinishedEpisode:
        """Returns the result of the episode if this call exceeds the time limit.

        Args:
            call_s: Duration of the call so far [s].
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
        seconds = known.seconds + self.agent_s + call_s
        result = replace(known, success=False, failure=AGENT_TIMEOUT, seconds=seconds)
        return FinishedEpisode(episode=result, timings_s={})


@dataclass(frozen=True, kw_only=True)
class CallEnded:
    """Message: the call of the agent has ended, after this time, stops included [s]."""

    call_s: float


@dataclass(kw_only=True)
class CallClock:
    """Duration of the agent's current call in a worker, as its parent counts it.

    Attributes:
        call: The call; None between two.
        counted_s: Its duration so far without stops [s].
        stopped_s: Stops since the call before [s].
    """

    call: CallStarted | None = None
    counted_s: float = 0.0
    stopped_s: float = 0.0

    def start(self, call: CallStarted) -> None:
        """Starts counting."""
        self.call, self.counted_s = call, 0.0

    def end(self, ended: CallEnded) -> None:
        """Sets the duration to that of the call, which has ended."""
        self.counted_s = ended.call_s - self.stopped_s
        self.stopped_s = 0.0

    def count(self, passed_s: float, stopped_s: float) -> None:
        """Counts time, a part of which was a stop."""
        self.stopped_s += stopped_s
        if self.call is not None:
            self.counted_s += passed_s - stopped_s


class StopWatch:
    """Counts the time of calls, but for that in which this process or theirs was stopped."""

    def __init__(self) -> None:
        """Starts."""
        self._last_s = time.monotonic()

    def tick(self, workers: Iterable[tuple[CallClock, Iterable[int]]]) -> None:
        """Counts the time since the last tick; to be called every `TICK_S` or more often.

        Args:
            workers: Clock of each worker, and the ids of the processes that it consists of.
        """
        passed_s = time.monotonic() - self._last_s
        if passed_s < TICK_S:
            return
        self._last_s += passed_s
        own_stop_s = passed_s - TICK_S if passed_s > LONGEST_TICK_S else 0.0
        for clock, processes in workers:
            stopped_s = passed_s if any(map(is_stopped, processes)) else own_stop_s
            clock.count(passed_s, stopped_s)


def is_stopped(process: int) -> bool:
    """Returns whether a process is stopped now; always False without /proc."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(") ")[2][:1] in ("T", "t")
    except OSError:
        return False


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
        self._send(CallStarted(agent_s=self._agent_s, partial_result=partial_result))
        started_s = time.monotonic()  # sending waits while the parent is stopped
        try:
            yield
        finally:
            call_s = time.monotonic() - started_s
            self._agent_s += call_s
            self._send(CallEnded(call_s=call_s))
