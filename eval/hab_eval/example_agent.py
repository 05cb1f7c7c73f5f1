"""The built-in baseline, and the shortest complete example of `hab_tasks.agent.Agent`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from hab_eval import environments
from hab_tasks.agent import AgentReport, AgentSetup, AgentSpec, check_options


class RandomAgent:
    """Samples actions uniformly from [-1, 1], with one generator per row."""

    def __init__(self, setup: AgentSetup) -> None:
        check_options(setup, {})
        control_mode = environments.continuous_control(setup.env_id)
        self.spec = AgentSpec(name="Random", control_mode=control_mode)
        self._size = environments.action_size(self.spec.control_mode)
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
