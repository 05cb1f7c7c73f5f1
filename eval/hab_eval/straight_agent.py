"""An agent without learning or planning: the hand goes straight to where the observation points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from hab_tasks.agent import AgentReport, AgentSetup, AgentSpec, check_options
from hab_tasks.constants import EE_STEP_M
from hab_tasks.errors import UnknownNameError
from hab_tasks.registration import imported_id

POINTS = {"HabPick-v1": "object_start_from_ee", "HabPlace-v1": "object_goal_from_ee"}
"""Environment -> observation of the point to go to."""

NEAR_M = {"HabPick-v1": 0.12, "HabPlace-v1": 0.05}
"""Distance from the point at which the hand grasps or releases: a grasp reaches 15 cm."""


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
