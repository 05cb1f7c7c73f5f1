"""The navigator as an agent, ``hab-eval run --agent hab_ppo:navigator``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from hab_navigator.navigator import REPEAT, Navigator, Stops
from hab_navigator.network import NAVIGATOR, WEIGHTS, load, shipped_navigator
from hab_tasks.agent import AgentReport, AgentSetup, AgentSpec, check_options
from hab_tasks.envs import ENVS
from hab_tasks.errors import OptionError
from hab_tasks.io.threads import use_one_thread
from hab_tasks.registration import imported_id
from hab_tasks.robots.control_modes import STOP_CELL
from hab_tasks.skills.navigate import NAVIGATE_ID

NAMES: dict[Stops, str] = {
    "often": "Navigator",
    "once": "Navigator (one stop)",
    "never": "Navigator (without stop)",
}
ROWS = 8
"""Episodes played at a time."""


class NavigatorAgent:
    """Navigates in several rows."""

    def __init__(self, setup: AgentSetup, path: Path, stops: Stops = "often") -> None:
        """Loads the weights of a file.

        Args:
            setup: Setup of the agent.
            path: The file.
            stops: When it stops.

        Raises:
            PolicyFileError: The file cannot be used.
            OptionError: The environment is another one.
        """
        use_one_thread()
        if imported_id(setup.env_id) != NAVIGATE_ID:
            raise OptionError(f"{NAVIGATOR} acts in {NAVIGATE_ID}, not {setup.env_id}.")
        self._network, self._device = load(path)[0].to(setup.device), setup.device
        self._stops: Stops = stops
        self.spec = AgentSpec(
            name=NAMES[stops],
            control_mode="base_discrete",
            obs_mode="depth",
            target_frame="base",
            rows=ROWS,
            files=(str(path),),
        )
        self._rows: list[Navigator] = []
        self._left: list[int] = []  # steps that an action is still executed for
        self._actions: list[int] = []

    def reset(self, mask: Tensor, seeds: Sequence[int]) -> None:
        """Starts episodes in the rows of `mask` (N,) bool; nothing is drawn at random."""
        if len(self._rows) != len(mask):
            self._rows = [self._new() for _ in mask]
            self._left, self._actions = [0] * len(mask), [0] * len(mask)
        for row in mask.nonzero()[:, 0].tolist():
            self._rows[row], self._left[row] = self._new(), 0

    def act(self, obs: Mapping[str, Any]) -> Tensor:
        """Returns cells of ``base_discrete`` (N, 1)."""
        depth = np.asarray(obs["sensor_data"]["head"]["depth"])
        points_m = np.asarray(obs["extra"]["point_in_base"], dtype=float)
        holding = np.asarray(obs["agent"]["is_holding"]).reshape(len(points_m)) > 0
        for row, navigator in enumerate(self._rows):
            if self._left[row] == 0:
                facts = depth[row], points_m[row], bool(holding[row])
                action = navigator.action(*facts)
                self._actions[row] = action
                self._left[row] = 1 if action == STOP_CELL else REPEAT
            self._left[row] -= 1
        return torch.tensor(self._actions)[:, None]

    def report(self) -> list[AgentReport]:
        """Returns empty reports."""
        return [AgentReport() for _ in self._rows]

    def _new(self) -> Navigator:
        robot = ENVS[NAVIGATE_ID].env.robot
        return Navigator(robot, self._network, self._device, self._stops)


def make_agent(setup: AgentSetup, stops: Stops = "often") -> NavigatorAgent:
    """Returns the agent; one for each way to stop is registered with `hab_ppo`.

    Option: ``weights``, a file or the folder of a run; by default, the weights that ship.

    Raises:
        PolicyFileError: The file cannot be used.
        UnknownNameError: An option is unknown.
    """
    check_options(setup, {"weights": None})
    path = weights_file(setup.options.get("weights"))
    return NavigatorAgent(setup, path, stops)


def weights_file(given: str | None) -> Path:
    """Returns the file of weights at a path, a run's folder or file; the shipped one for None."""
    if given is None:
        return shipped_navigator()
    path = Path(given).expanduser()
    return path / WEIGHTS if path.is_dir() else path


navigator = partial(make_agent, stops="often")
navigator_once = partial(make_agent, stops="once")
navigator_without_stop = partial(make_agent, stops="never")
