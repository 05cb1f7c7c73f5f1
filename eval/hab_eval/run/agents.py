"""Loads agents by ``module:factory``, independently of any baseline, and the built-in agents.

`RandomAgent` is the shortest complete example of `hab_tasks.agent.Agent`.
Agents that stand still must not solve any episode: their success on the leaderboard is zero.
"""

from __future__ import annotations

import difflib
import importlib
import inspect
import pkgutil
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import metadata
from types import ModuleType
from typing import Any, Literal

import torch
from torch import Tensor

from hab_eval.errors import AgentError
from hab_eval.records.provenance import search_here
from hab_eval.run import environments
from hab_eval.run.agent_checks import check_agent, loading
from hab_tasks.agent import Agent, AgentReport, AgentSetup, AgentSpec, check_options
from hab_tasks.constants import EE_STEP_M
from hab_tasks.errors import UnknownNameError
from hab_tasks.registration import imported_id

Hand = Literal["keep", "close", "open"]

NAMES: dict[Hand, str] = {
    "keep": "Do nothing",
    "close": "Close the hand only",
    "open": "Open the hand only",
}

POINTS = {"HabPick-v1": "object_start_from_ee", "HabPlace-v1": "object_goal_from_ee"}
"""Environment -> observation of the point to go to."""

NEAR_M = {"HabPick-v1": 0.12, "HabPlace-v1": 0.05}
"""Distance from the point at which the hand grasps or releases: a grasp reaches 15 cm."""


class RandomAgent:
    """Samples actions uniformly from [-1, 1], with one generator per row."""

    def __init__(self, setup: AgentSetup) -> None:
        check_options(setup, {})
        control_mode = environments.continuous_control(setup.env_id)
        self.spec = AgentSpec(name="Random", control_mode=control_mode)
        self._size = environments.action_size(setup.env_id, control_mode, setup.robot)
        self._generators: list[torch.Generator] = []

    def reset(self, mask: Tensor, seeds: Sequence[int]) -> None:
        """Seeds the generators of the rows in `mask` (N,) bool."""
        if len(self._generators) != len(mask):
            self._generators = [torch.Generator() for _ in seeds]
        for row in mask.nonzero().flatten().tolist():
            self._generators[row].manual_seed(seeds[row])

    def act(self, obs: Mapping[str, Any]) -> Tensor:
        """Returns uniform actions (N, A) float32; ignores the observation."""
        rows = [torch.rand(self._size, generator=own) for own in self._generators]
        return 2.0 * torch.stack(rows) - 1.0

    def report(self) -> list[AgentReport]:
        """Returns empty reports."""
        return [AgentReport() for _ in self._generators]


class StandingAgent:
    """Moves neither arm nor base; keeps the gripper as it is, or closes or opens it."""

    def __init__(self, setup: AgentSetup, hand: Hand) -> None:
        check_options(setup, {})
        control_mode = environments.continuous_control(setup.env_id)
        self.spec = AgentSpec(name=NAMES[hand], control_mode=control_mode)
        self._hand = hand
        size = environments.action_size(setup.env_id, control_mode, setup.robot)
        self._still = torch.zeros(1, size)
        self._entry = environments.gripper_entry(setup.env_id, control_mode, setup.robot)

    def reset(self, mask: Tensor, seeds: Sequence[int]) -> None:
        """Sets the number of rows; the agent has no other state."""
        self._still = self._still[:1].repeat(len(mask), 1)

    def act(self, obs: Mapping[str, Any]) -> Tensor:
        """Returns zeros (N, A) float32 except for the gripper; zero velocity is the stop action."""
        action = self._still.clone()
        if self._entry is not None:
            action[:, self._entry] = self._gripper(obs)
        return action

    def report(self) -> list[AgentReport]:
        """Returns empty reports."""
        return [AgentReport() for _ in self._still]

    def _gripper(self, obs: Mapping[str, Any]) -> Tensor | float:
        """Returns the gripper entry (N,): >= 0 grasps if the gripper is empty, < 0 releases."""
        if self._hand != "keep":
            return 1.0 if self._hand == "close" else -1.0
        holding = torch.as_tensor(obs["agent"]["is_holding"]).reshape(len(self._still))
        return torch.where(holding > 0.5, 1.0, -1.0)


class StraightAgent:
    """Moves the hand straight to the point, grasps or releases there, and straight to rest."""

    def __init__(self, setup: AgentSetup) -> None:
        """Checks environment and options.

        Raises:
            UnknownNameError: The environment is neither Pick nor Place, or there are options.
        """
        check_options(setup, {})
        env_id = imported_id(setup.env_id)
        if env_id not in POINTS:
            raise UnknownNameError("environment of straight_line", env_id, POINTS)
        self.spec = AgentSpec(name="Straight line", control_mode="ee")
        self._point, self._near_m = POINTS[env_id], NEAR_M[env_id]
        self._fetches = env_id == "HabPick-v1"
        self._rows = 1

    def reset(self, mask: Tensor, seeds: Sequence[int]) -> None:
        """Sets the number of rows; the agent has no other state."""
        self._rows = len(mask)

    def act(self, obs: Mapping[str, Any]) -> Tensor:
        """Returns actions (N, 4) float32: shares of the hand's maximum step, and the gripper."""
        point_m = torch.as_tensor(obs["extra"][self._point])
        rest_m = torch.as_tensor(obs["agent"]["rest_from_ee"])
        holding = torch.as_tensor(obs["agent"]["is_holding"]).reshape(-1) > 0.5
        near = point_m.norm(dim=1) < self._near_m
        over = holding == self._fetches  # has or has placed its object
        move = torch.where(over[:, None], rest_m, point_m) / EE_STEP_M
        move = move / move.norm(dim=1, keepdim=True).clamp(min=1.0)
        closed = (holding | near) if self._fetches else (holding & ~near)
        return torch.cat((move, torch.where(closed, 1.0, -1.0)[:, None]), dim=1)

    def report(self) -> list[AgentReport]:
        """Returns empty reports."""
        return [AgentReport() for _ in range(self._rows)]


def random_agent(setup: AgentSetup) -> Agent:
    """Returns the built-in baseline: uniform random actions, seeded per episode."""
    return RandomAgent(setup)


def do_nothing(setup: AgentSetup) -> Agent:
    """Returns an agent that stands still and keeps holding its object."""
    return StandingAgent(setup, hand="keep")


def close_hand(setup: AgentSetup) -> Agent:
    """Returns an agent that stands still and closes the gripper."""
    return StandingAgent(setup, hand="close")


def open_hand(setup: AgentSetup) -> Agent:
    """Returns an agent that stands still and opens the gripper."""
    return StandingAgent(setup, hand="open")


def straight_line(setup: AgentSetup) -> Agent:
    """Returns an agent of Pick and Place whose hand goes straight to the point and to rest."""
    return StraightAgent(setup)


def load_agent(reference: str, setup: AgentSetup) -> Agent:
    """Imports ``module:factory`` and calls the factory.

    Raises:
        UnknownNameError: The module has no such factory.
        AgentError: The reference is malformed, the module is not found or cannot be imported, the
            factory raises, or its return value is not an `Agent`.
        RunStoppedError: The module or the factory calls `sys.exit`.
    """
    module_name, colon, factory_name = reference.partition(":")
    if not (colon and module_name):
        raise AgentError(
            f"Agent {reference!r} is not of the form module:factory, e.g. hab_eval:random_agent."
        )
    with loading(f"Agent module {module_name!r}"):
        module = _import(module_name)
        factory = getattr(module, factory_name, None)
        if not callable(factory):
            raise UnknownNameError(f"agent in {module_name}", factory_name, _factories(module))
    with loading(f"The factory of agent {reference!r}"):
        return check_agent(factory(setup), reference)


def _import(name: str) -> ModuleType:
    """Imports an agent's module from the working directory or the installed packages."""
    here = search_here()
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        missing = error.name or ""
        if name == missing or name.startswith(f"{missing}."):
            raise AgentError(_not_found(name, missing, here)) from error
        raise AgentError(
            f"Agent module {name!r} needs {missing!r}, which is not installed."
        ) from error
    except ImportError as error:
        raise AgentError(f"Agent module {name!r} cannot be imported: {error}") from error


def _not_found(name: str, missing: str, here: str) -> str:
    """Returns a message with the searched paths and the nearest module name."""
    parent, _, last = missing.rpartition(".")
    if parent:
        folders = getattr(sys.modules.get(parent), "__path__", [])  # [] if it is not a package
        names = {module.name for module in pkgutil.iter_modules(folders)}
        where = f"in the package {parent!r}"
    else:
        names = {module.name for module in pkgutil.iter_modules()}
        names |= metadata.packages_distributions().keys()  # iter_modules lacks editable installs
        where = f"in the working directory ({here}) nor among the installed packages"
    near = difflib.get_close_matches(last, names, n=1)
    hint = f" Did you mean {f'{parent}.{near[0]}'.lstrip('.')!r}?" if near else ""
    return f"Agent module {name!r} is {'not' if parent else 'neither'} {where}.{hint}"


def _factories(module: ModuleType) -> list[str]:
    """Returns a module's public callables whose only required argument is an `AgentSetup`.

    Its own functions and classes may leave out the annotation.
    """
    members = ((name, getattr(module, name)) for name in dir(module) if not name.startswith("_"))
    return [
        name
        for name, value in members
        if callable(value)
        and _takes_setup(value, getattr(value, "__module__", None) == module.__name__)
    ]


def _takes_setup(factory: Callable[..., Any], is_own: bool) -> bool:
    try:
        parameters = inspect.signature(factory).parameters.values()
    except (TypeError, ValueError):
        return False  # a built-in without a signature
    named = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    needed = [p for p in parameters if p.default is p.empty and p.kind not in named]
    if len(needed) != 1:
        return False
    annotation = needed[0].annotation
    return "AgentSetup" in str(annotation) or (is_own and annotation is inspect.Parameter.empty)
