"""The contract between agents and the evaluator.

An agent never holds the environment. Its factory is called once in each process that needs the
agent, before any environment exists:

1. The evaluator calls ``factory(setup)``.
2. The factory decides on an `AgentSpec`: control mode, observations, number of rows.
3. ``setup.spaces(spec)`` tells which spaces and cameras an environment made for that spec has, so
   that the factory can build its network, on ``setup.device``.
4. The evaluator reads ``agent.spec`` and makes the environments accordingly.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from hab_tasks.errors import HabError, UnknownNameError

if TYPE_CHECKING:
    from gymnasium import spaces

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
        target_frame: The environment's option `target_frame`: whether the target of a skill is told
            along the axes of the ``base`` or in the frame of the end-effector, ``ee``.
        handle_position: The environment's option `handle_position`: whether the handle of the door
            or drawer is told as well. The leaderboard names both where they are not the usual.
        rows: How many rows one call of `act` can take. With more than one, that many episodes are
            played at the same time. `reset` tells the number of rows N <= `rows` by the length of
            its mask; N stays the same for the whole run.
    """

    name: str
    control_mode: str
    obs_mode: str = "state_dict"
    privileged: bool = False
    looks: Looks = "always"
    target_frame: TargetFrame = "base"
    handle_position: bool = False
    rows: int = 1


@dataclass(frozen=True, kw_only=True)
class CameraParameters:
    """A camera of the robot; the same in every episode.

    Attributes:
        width_px: Width of its pictures.
        height_px: Height of its pictures.
        intrinsics_px: (3, 3) matrix of the pinhole model.
        link: The link of Fetch that it moves with.
        link_from_camera: (4, 4) pose in that link's frame, of a camera that looks along z with x
            to the right and y down (OpenCV's axes). ``sensor_param`` has the pose in the world.
    """

    width_px: int
    height_px: int
    intrinsics_px: NDArray[np.float64]
    link: str
    link_from_camera: NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class AgentSpaces:
    """What an environment made for an `AgentSpec` takes and gives.

    Attributes:
        observation: Space of one row of the observation, without the batch dimension and without
            ``privileged``.
        action: Space of one row of the action.
        cameras: Camera name -> its parameters; empty without images.
    """

    observation: spaces.Space[Any]
    action: spaces.Space[Any]
    cameras: Mapping[str, CameraParameters]


def _no_spaces(env_id: str, spec: AgentSpec) -> AgentSpaces:
    raise HabError(
        "This AgentSetup knows no spaces; make it with hab_tasks.agent_spaces.agent_setup(env_id)."
    )


@dataclass(frozen=True, kw_only=True)
class AgentSetup:
    """What an agent's factory is told; `hab_tasks.agent_spaces.agent_setup` makes one.

    Attributes:
        env_id: Environment id.
        seed: The run's seed.
        options: The agent's own options, name -> value; the factory refuses what it does not know
            (see `check_options`).
        device: Where the agent's networks are to run, as torch names it: ``cpu``, ``cuda:1``.
            Observations come as CPU tensors; actions may be on any device.
        spaces_of: (env_id, spec) -> spaces and cameras of that environment; see `spaces`.
    """

    env_id: str
    seed: int = 0
    options: Mapping[str, str] = field(default_factory=dict)
    device: str = "cpu"
    spaces_of: Callable[[str, AgentSpec], AgentSpaces] = _no_spaces

    def spaces(self, spec: AgentSpec) -> AgentSpaces:
        """Returns the spaces and cameras of the environment made for a spec, without making it.

        Raises:
            HabError: The environment is not known, or does not offer what the spec asks for.
        """
        return self.spaces_of(self.env_id, spec)


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
        """Forgets the past of the rows in `mask` (N,) bool and seeds each row with `seeds` (N,).

        In the first call of a run all rows are in the mask. Later, rows start new episodes while
        others go on.
        """
        ...

    def act(self, obs: Mapping[str, Any]) -> Tensor:
        """Returns actions (N, A) float32 for the observations of all N rows.

        A row whose episode is over keeps its last observation; its action is not used.
        """
        ...

    def report(self) -> list[AgentReport]:
        """Returns one report for each of the N rows; at the end of an episode or at any step."""
        ...
