"""Trivial agents that stand still and at most open or close the gripper.

They must not solve any episode: their success on the leaderboard is zero.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import torch
from torch import Tensor

from hab_eval import environments
from hab_tasks.agent import AgentReport, AgentSetup, AgentSpec, check_options

Hand = Literal["keep", "close", "open"]

NAMES: dict[Hand, str] = {
    "keep": "Do nothing",
    "close": "Close the hand only",
    "open": "Open the hand only",
}


class StandingAgent:
    """Moves neither arm nor base; keeps the gripper as it is, or closes or opens it."""

    def __init__(self, setup: AgentSetup, hand: Hand) -> None:
        check_options(setup, {})
        control_mode = environments.continuous_control(setup.env_id)
        self.spec = AgentSpec(name=NAMES[hand], control_mode=control_mode)
        self._hand = hand
        self._still = torch.zeros(1, environments.action_size(control_mode))
        self._entry = environments.gripper_entry(control_mode)

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
