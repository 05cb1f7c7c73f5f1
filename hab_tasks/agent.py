"""The contract between agents and the evaluator.

Agents have no access to the environment object. An agent's factory is called once per process,
before any environment exists:

1. The evaluator calls ``factory(setup)``.
2. The factory decides on an `AgentSpec`: control mode, observations, number of rows.
3. ``setup.spaces(spec)`` returns the spaces and cameras of an environment made for that spec. The
   factory can use them to build its network on ``setup.device``.
4. The evaluator reads ``agent.spec`` and makes the environments accordingly.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from hab_tasks.constants import CAMERA_HFOV_RAD, CAMERA_SIZE_PX
from hab_tasks.errors import HabError, UnknownNameError

if TYPE_CHECKING:
    from gymnasium import spaces

Looks = Literal["always", "on demand"]

TargetFrame = Literal["base", "ee"]
"""Frame of a skill's target in the observation: axes of the base, or the end-effector's frame."""

Targets = Literal["positions", "language"]
"""How the goal is given: by positions in the observation, or by the instruction only."""

InstructionOf = Literal["task", "stage", None]
"""What an observed instruction is of: the whole episode, or the current stage of a task."""


@dataclass(frozen=True, kw_only=True)
class AgentSpec:
    """Environment options that an agent needs; read before the environment is made.

    Attributes:
        name: Name displayed in results, e.g. ``SPA-Priv``.
        control_mode: A control mode of the robot, e.g. ``ee``, ``joint_delta``, ``joint_target``.
        obs_mode: ManiSkill observation mode, e.g. ``state_dict``, ``depth``.
        privileged: Whether observations must contain ``obs["privileged"]``, a list of N
            `hab_tasks.privileged.PrivilegedState`, which is read when `act` asks for it. The
            leaderboard marks such agents.
        looks: When the images of `obs_mode` are rendered: ``always``, or ``on demand``, only in
            steps in which `act` reads ``obs["sensor_data"]`` or ``obs["sensor_param"]``, which
            renders those of all rows, or calls `of_rows` for those of some.
        target_frame: The environment option `target_frame`: whether the target of a skill is
            given along the axes of the ``base`` or in the frame of the end-effector, ``ee``.
        handle_position: The environment option `handle_position`: whether the observation also
            contains the handle of the door or drawer. The leaderboard shows both options where
            they differ from the defaults.
        targets: The environment option `targets`: with ``language``, the observation has no
            position of an object, goal, handle or receptacle. The leaderboard never compares such
            agents with others.
        instruction: Adds ``obs["instruction"]``, N strings: the instruction of the ``task``, or of
            its current ``stage``.
        cameras: Names of the cameras in observations with images; None for the environment's.
        camera_size_px: Width and height of their images.
        camera_hfov_rad: Their horizontal field of view.
        invisible_arm: The environment option `invisible_arm`.
        proprioception: The environment option `proprioception`.
        rows: Maximum batch size of `act`. With more than one row, that many episodes run in
            parallel. The length of the mask passed to `reset` is the number of rows N <= `rows`;
            N is constant during a run.
        files: Paths of the files that its actions depend on, e.g. of weights. The result of a run
            states their SHA-256.
    """

    name: str
    control_mode: str
    obs_mode: str = "state_dict"
    privileged: bool = False
    looks: Looks = "always"
    target_frame: TargetFrame = "base"
    handle_position: bool = False
    targets: Targets = "positions"
    instruction: InstructionOf = None
    cameras: tuple[str, ...] | None = None
    camera_size_px: int = CAMERA_SIZE_PX
    camera_hfov_rad: float = CAMERA_HFOV_RAD
    invisible_arm: bool = False
    proprioception: bool = True
    rows: int = 1
    files: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class CameraParameters:
    """Parameters of a robot camera; constant across episodes.

    Attributes:
        width_px: Image width.
        height_px: Image height.
        intrinsics_px: (3, 3) matrix of the pinhole model.
        link: The robot link that the camera is mounted on.
        link_from_camera: (4, 4) pose of the camera in that link's frame, in the OpenCV convention
            (z forward, x right, y down). ``sensor_param`` holds the pose in the world.
    """

    width_px: int
    height_px: int
    intrinsics_px: NDArray[np.float64]
    link: str
    link_from_camera: NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class AgentSpaces:
    """Spaces and cameras of an environment made for an `AgentSpec`.

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
        "This AgentSetup has no spaces; create it with hab_tasks.agent_spaces.agent_setup(env_id)."
    )


@dataclass(frozen=True, kw_only=True)
class AgentSetup:
    """Arguments of an agent's factory; created by `hab_tasks.agent_spaces.agent_setup`.

    Attributes:
        env_id: Environment id.
        seed: The run's seed.
        options: The agent's own options, name -> value; the factory rejects unknown names (see
            `check_options`).
        device: Torch device of the agent's networks: ``cpu``, ``cuda:1``. Observations are CPU
            tensors; actions may be on any device.
        robot: Uid of the robot; None for the environment's.
        spaces_of: (env_id, spec) -> spaces and cameras of that environment; see `spaces`.
    """

    env_id: str
    seed: int = 0
    options: Mapping[str, str] = field(default_factory=dict)
    device: str = "cpu"
    robot: str | None = None
    spaces_of: Callable[[str, AgentSpec], AgentSpaces] = _no_spaces

    def spaces(self, spec: AgentSpec) -> AgentSpaces:
        """Returns the spaces and cameras of an environment without making it.

        Raises:
            HabError: The environment is unknown, or does not support the spec.
        """
        return self.spaces_of(self.env_id, spec)


def check_options(setup: AgentSetup, known: Mapping[str, Collection[str] | None]) -> None:
    """Rejects options unknown to an agent; for use in its factory.

    Args:
        setup: Argument of the factory.
        known: Option -> valid values, or None if the agent checks the value itself. Empty for an
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


def of_rows(obs: Mapping[str, Any], rows: Sequence[int]) -> Mapping[str, Any]:
    """Returns the observation of some rows; images on demand are rendered for these only."""
    own = getattr(obs, "of_rows", None)
    return _indexed(obs, list(rows)) if own is None else own(rows)


def _indexed(value: Any, rows: list[int]) -> Any:
    """Returns the rows of nested groups of tensors (N, ...), or lists of N entries."""
    if isinstance(value, Mapping):
        return {name: _indexed(part, rows) for name, part in value.items()}
    return [value[row] for row in rows] if isinstance(value, list) else value[rows]


@dataclass(frozen=True, kw_only=True)
class AgentReport:
    """Report of an agent on the episode so far, one per row.

    The evaluator may request it after every step, so it has to be cheap.

    Attributes:
        failure: The agent's own failure category (e.g. ``target plan``), or None.
        timings_s: Named durations in seconds, e.g. ``{"plan": 0.21}``.
        doing: Current activity, e.g. ``3/20 pick(bowl, drawer): reach``; for videos.
        trace: Beliefs and actions in order; JSON-serialisable entries.
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
        """Resets the rows in `mask` (N,) bool and seeds each row with `seeds` (N,).

        The first call of a run resets all rows. Later calls reset single rows while the others
        continue.
        """
        ...

    def act(self, obs: Mapping[str, Any]) -> Tensor:
        """Returns actions (N, A) float32 for the observations of all N rows.

        A row whose episode is over keeps its last observation; its action is ignored.
        """
        ...

    def report(self) -> list[AgentReport]:
        """Returns one report per row; called at the end of an episode or at any step."""
        ...
