"""A batched agent that moves the hand to the target, grasps it and returns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from hab_tasks.agent import AgentReport, AgentSetup, AgentSpec, check_options
from hab_tasks.constants import EE_STEP_M, GRASP_RADIUS_M


class ReachingAgent:
    """Keeps a memory for each row, so that rows that were mixed up would act otherwise."""

    def __init__(self, setup: AgentSetup) -> None:
        check_options(setup, {"rows": None, "obs_mode": None, "looks": None, "privileged": None})
        options = setup.options
        self.spec = AgentSpec(
            name="Reaching",
            control_mode="ee",
            rows=int(options.get("rows", "1")),
            obs_mode=options.get("obs_mode", "state_dict"),
            looks=options.get("looks", "always"),
            privileged="privileged" in options,
        )
        spaces = setup.spaces(self.spec)
        self._size = spaces.action.shape[0]
        self._cameras = spaces.cameras
        self._device = torch.device(setup.device)
        self._steps = torch.zeros(0)

    def reset(self, mask: Tensor, seeds: Sequence[int]) -> None:
        """Forgets how long the rows in `mask` have been playing."""
        if len(self._steps) != len(mask):
            assert mask.all()
            self._steps = torch.zeros(len(mask))
        self._steps[mask] = 0.0

    def act(self, obs: Mapping[str, Any]) -> Tensor:
        """Returns actions (N, A): to the target, in a little spiral of each row's own time."""
        target_m = obs["extra"]["object_start_from_ee"]
        holding, rest = obs["agent"]["is_holding"], obs["agent"]["rest_from_ee"]
        assert len(target_m) == len(self._steps)
        way_m = torch.where(holding > 0, rest, target_m)
        turn = torch.stack((self._steps.cos(), self._steps.sin(), 0 * self._steps), dim=1)
        move = (way_m / EE_STEP_M).clamp(-1, 1) * 0.8 + 0.2 * turn
        if self._cameras:  # what is far away in the head camera's picture makes it go slower
            depth = obs["sensor_data"]["head"]["depth"].reshape(len(move), -1)
            move = move * (0.5 + 0.5 * depth[:, :1])
        if self.spec.privileged:
            held = torch.tensor([float(state.held is not None) for state in obs["privileged"]])
            assert torch.equal(held[:, None], holding)
            assert all(len(state.bodies) > len(state.articulations) for state in obs["privileged"])
        near = target_m.norm(dim=1, keepdim=True) < 0.9 * GRASP_RADIUS_M
        grip = torch.where(near | (holding > 0), 1.0, -1.0)
        self._steps = self._steps + 1
        return torch.cat((move, grip), dim=1).to(self._device)

    def report(self) -> list[AgentReport]:
        """Returns how long each row has been playing."""
        told = map(int, self._steps)
        return [AgentReport(trace=({"steps": n},), doing=f"reach, step {n}") for n in told]


def reaching(setup: AgentSetup) -> ReachingAgent:
    """Makes the agent. Options: ``rows``, ``obs_mode``, ``looks``, ``privileged``."""
    return ReachingAgent(setup)
