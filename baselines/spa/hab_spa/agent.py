"""The agent SPA-Priv: sense-plan-act with the true geometry of the scene (S App. D)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from hab_spa.collision import ShapeCache
from hab_spa.pick import PickConfig, PickSkill
from hab_tasks.agent import AgentReport, AgentSetup, AgentSpec
from hab_tasks.errors import UnknownNameError
from hab_tasks.privileged import PrivilegedState

SKILLS = ("HabPick-v1",)


class SpaPrivAgent:
    """Runs one `PickSkill` for each environment row."""

    def __init__(self, setup: AgentSetup, config: PickConfig | None = None) -> None:
        """Makes the agent; `config` defaults to the paper's values.

        Raises:
            UnknownNameError: `setup.env_id` is no skill that this agent can do.
        """
        env_id = setup.env_id.rsplit(":", 1)[-1]
        if env_id not in SKILLS:
            raise UnknownNameError("environment of SPA-Priv", env_id, SKILLS)
        self.spec = AgentSpec(name="SPA-Priv", control_mode="joint_target", privileged=True)
        self._config = config or PickConfig()
        self._caches = [ShapeCache() for _ in range(setup.num_envs)]
        self._skills = [
            PickSkill(setup.seed + row, self._config, cache)
            for row, cache in enumerate(self._caches)
        ]

    def reset(self, mask: Tensor, seeds: Sequence[int]) -> None:
        """Starts a new episode in the rows of `mask` (N,) bool, seeded with `seeds` (N,)."""
        for row in torch.nonzero(mask).flatten().tolist():
            self._skills[row] = PickSkill(int(seeds[row]), self._config, self._caches[row])

    def act(self, obs: Mapping[str, Any]) -> Tensor:
        """Returns actions (N, 8) float32: seven joint targets [rad], then the gripper."""
        states: list[PrivilegedState] = obs["privileged"]
        rows = []
        for skill, state in zip(self._skills, states, strict=True):
            targets_rad, gripper = skill.act(state)
            rows.append(np.append(targets_rad, gripper))
        return torch.from_numpy(np.array(rows, dtype=np.float32))

    def report(self) -> list[AgentReport]:
        """Returns each row's failure category (S App. I.1) and planning times."""
        return [
            AgentReport(
                failure=skill.failure.value if skill.failure is not None else None,
                timings_s=dict(skill.timings_s),
            )
            for skill in self._skills
        ]


def spa_priv(setup: AgentSetup) -> SpaPrivAgent:
    """Factory of SPA-Priv, for ``hab-eval run --agent hab_spa:spa_priv``."""
    return SpaPrivAgent(setup)
