"""A limit on the time of an agent's calls: what its worker process tells the parent about them.

A call that hangs, perhaps inside a library, cannot be ended from within. So the worker announces
every call before it makes it, with the result of the episode so far, and the parent ends the
process of a call that takes too long.
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
class Asked:
    """The agent is asked for something.

    Attributes:
        at_s: When, on the clock that all processes of a machine share [s].
        agent_s: How long the agent has taken in this episode before [s].
        so_far: How the episode went until now; None before its first step.
    """

    at_s: float
    agent_s: float = 0.0
    so_far: EpisodeResult | None = None

    def late(self, now_s: float, episode: Episode) -> FinishedEpisode:
        """Returns the episode as it is counted when this call takes too long.

        Args:
            now_s: Time of giving up [s].
            episode: The episode that is played.
        """
        known = self.so_far or EpisodeResult(
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
class Answered:
    """The agent has answered, at this time [s]."""

    at_s: float


class TimedAgent:
    """An agent of one row that announces each call; otherwise the agent that it holds."""

    def __init__(
        self, agent: Agent, rows: LocalRows, send: Callable[[Asked | Answered], None]
    ) -> None:
        """Announces the calls of `agent`, which plays in `rows`, with `send`."""
        self.spec = agent.spec
        self._agent, self._rows, self._send = agent, rows, send
        self._agent_s = 0.0

    def reset(self, mask: Tensor, seeds: Sequence[int]) -> None:
        """Starts an episode, in which nothing has happened yet."""
        self._agent_s = 0.0
        with self._announced(None):
            self._agent.reset(mask, seeds)

    def act(self, obs: Mapping[str, Any]) -> Tensor:
        """Returns the agent's actions (1, A)."""
        with self._announced(self._rows.so_far()):
            return self._agent.act(obs)

    def report(self) -> list[AgentReport]:
        """Returns the agent's report."""
        with self._announced(self._rows.so_far()):
            return self._agent.report()

    @contextlib.contextmanager
    def _announced(self, so_far: EpisodeResult | None) -> Generator[None, None, None]:
        asked = Asked(at_s=time.monotonic(), agent_s=self._agent_s, so_far=so_far)
        self._send(asked)
        try:
            yield
        finally:
            now_s = time.monotonic()
            self._agent_s += now_s - asked.at_s
            self._send(Answered(at_s=now_s))
