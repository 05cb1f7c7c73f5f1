"""Any agent of a skill's environment as that skill in tasks, e.g. a policy of another library."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, cast

import torch
from gymnasium import spaces
from hab_eval.run.load_agent import load_agent

from hab_tasks.agent import Agent, AgentSetup, of_rows
from hab_tasks.envs import ENVS
from hab_tasks.errors import OptionError
from hab_tasks.registration import SKILLS, TASK_SKILLS
from hab_tasks.robots.control import HabControllerConfig, control_configs
from hab_tp_srl.policies import ARMS, BASES, TASK_ENTRIES, Turn


class AgentPolicy:
    """Runs an agent of its own for each row; the attributes are those of `SkillPolicy`."""

    starts = None

    def __init__(
        self, setup: AgentSetup, skill: str, reference: str, options: Mapping[str, str]
    ) -> None:
        """Loads the agent.

        Args:
            setup: Setup of the task's agent; its options are not passed on.
            skill: Name of the skill in tasks.
            reference: ``module:factory``.
            options: Options of the agent.

        Raises:
            HabError: The agent cannot be loaded, or it cannot act in a task.
        """
        named = {ENVS[env_id].env.name: env_id for env_id in SKILLS} | TASK_SKILLS
        inner = replace(setup, env_id=named[skill], options=dict(options))
        self._make = partial(load_agent, reference, inner)
        self._agents: list[Agent] = [self._make()]
        spec = self._agents[0].spec
        self.name, self.obs_mode, self.files = spec.name, spec.obs_mode, spec.files
        self.sees_images = not spec.obs_mode.startswith("state")
        self.horizon_steps = ENVS[inner.env_id].env.horizon_steps
        self.control: HabControllerConfig = control_configs(ENVS[inner.env_id].env.robot)[
            spec.control_mode
        ]
        space = cast(spaces.Dict, setup.spaces_of(inner.env_id, spec).observation)
        self._entries = [(g, name) for g in ("agent", "extra") for name in cast(Any, space[g])]
        told = [name for group, name in self._entries if group == "agent" or name in TASK_ENTRIES]
        acts = self.control.arm in ARMS and self.control.base in BASES
        if spec.privileged or len(told) < len(self._entries) or not acts:
            raise OptionError(
                f"{reference} cannot act in a task as {skill}: it needs ground truth, observes "
                f"what a task does not tell, or acts by control_mode {spec.control_mode}."
            )
        self.sees_handles = ("extra", "handle_from_ee") in self._entries

    def goes_on(self, turn: Turn) -> bool:
        """See `SkillPolicy.goes_on`; a further attempt starts anew."""
        return False

    def decide(self, rows: Sequence[int], turns: Sequence[Turn], obs: Mapping[str, Any]) -> None:
        """See `SkillPolicy.decide`."""
        for row, turn in zip(rows, turns, strict=True):
            while row >= len(self._agents):
                self._agents.append(self._make())
            agent = self._agents[row]
            if turn.age == 0:
                assert turn.random is not None
                agent.reset(torch.ones(1, dtype=torch.bool), [int(turn.random.integers(2**31))])
            turn.age += 1
            seen: dict[str, Any] = {"agent": {}, "extra": {}}
            for group, name in self._entries:
                seen[group][name] = torch.from_numpy(turn.entries[group, name])[None]
            if self.sees_images:
                images = of_rows(obs, [row])
                seen |= {name: images[name] for name in ("sensor_data", "sensor_param")}
            turn.action = agent.act(seen)[0].detach().cpu().numpy().reshape(-1)
