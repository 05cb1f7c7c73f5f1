"""The small contract between whatever acts and whatever evaluates it.

An agent never holds the environment. It states in `AgentSpec` what it needs (control mode,
observations, privileged state), and the evaluator makes the environment accordingly.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, runtime_checkable

from torch import Tensor

from hab_tasks.errors import UnknownNameError

Looks = Literal["always", "on demand"]

TargetFrame = Literal["base", "ee"]
"""How a skill tells its target: along the axes of the base, or in the end-effector's frame."""


@dataclass(frozen=True, kw_only=True)
class AgentSpec:
    """What an agent needs from the environment; read before the environment is made.

    Attributes:
        name: Name shown in results, e.g. ``SPA-Priv``.
        control_mode: A control mode of `hab_fetch`, e.g. ``ee``, ``joint_delta``, ``joint_target``.
        obs_mode: ManiSkill observation mode, e.g. ``state_dict``, ``depth``.
        privileged: Whether observations must hold ``obs["privileged"]``, a list of N
            `hab_tasks.privileged.PrivilegedState`. The leaderboard marks such agents.
        looks: Whether the images of `obs_mode` are rendered ``always``, or ``on demand``: only in
            the steps in which `act` reads ``obs["sensor_data"]`` or ``obs["sensor_param"]``.
    """

    name: str
    control_mode: str
    obs_mode: str = "state_dict"
    privileged: bool = False
    looks: Looks = "always"
    target_frame: TargetFrame = "base"
    handle_position: bool = False


@dataclass(frozen=True, kw_only=True)
class AgentSetup:
    """What an agent's factory is told.

    Attributes:
        env_id: Environment id.
        num_envs: Number of rows.
        seed: The run's seed.
        options: The agent's own options, name -> value; the factory refuses what it does not know
            (see `check_options`).
    """

    env_id: str
    num_envs: int = 1
    seed: int = 0
    options: Mapping[str, str] = field(default_factory=dict)


def check_options(setup: AgentSetup, known: Mapping[str, Collection[str] | None]) -> None:
    """Refuses options that an agent does not know; for its factory.

    Args:
        setup: What the factory was given.
        known: Option -> its valid values, None if the agent checks the value itself. Empty for an
            agent without options.

    Raises:
        UnknownNameError: With the valid names and the nearest match.
    """
    for name, value in setup.options.items():
        if name not in known:
            raise UnknownNameError("option of the agent", name, known)
        valid = known[name]
        if valid is not None and value not in valid:
            raise UnknownNameError(f"value of the agent's option {name}", value, valid)


@dataclass(frozen=True, kw_only=True)
class AgentReport:
    """What an agent says about the episode so far, one a row.

    It may be asked for after every step, so it has to be cheap.

    Attributes:
        failure: The agent's own failure category (e.g. ``target plan``), None if none.
        timings_s: Named durations in seconds, e.g. ``{"plan": 0.21}``.
        doing: What the agent is doing now, e.g. ``3/20 pick(bowl, drawer): reach``; for videos.
        trace: What it believed and did, in order; entries of values that JSON knows.
    """

    failure: str | None = None
    timings_s: dict[str, float] = field(default_factory=dict)
    doing: str = ""
    trace: tuple[dict[str, Any], ...] = ()


@runtime_checkable
class Agent(Protocol):
    """Maps batched observations to batched actions."""

    spec: AgentSpec

    def reset(self, mask: Tensor, seeds: Sequence[int]) -> None:
        """Forgets the past of the rows in `mask` (N,) bool and seeds each row with `seeds` (N,)."""
        ...

    def act(self, obs: Mapping[str, Any]) -> Tensor:
        """Returns actions (N, A) float32 for the observations of all N rows."""
        ...

    def report(self) -> list[AgentReport]:
        """Returns one report for each of the N rows; at the end of an episode or at any step."""
        ...
