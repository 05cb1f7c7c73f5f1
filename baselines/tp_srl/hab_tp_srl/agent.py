"""TP+SRL's agent: executes a plan in each row, and evaluates policies for all rows together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from hab_plans.motion import Command
from hab_spa.agents.agent import SpaAgent

from hab_tasks.agent import AgentReport
from hab_tp_srl.fault import fault
from hab_tp_srl.policies import Decider
from hab_tp_srl.skill import PolicyCommand


class TpSrlAgent(SpaAgent):
    """Runs the executor's motion in each row."""

    def decide(self, commands: list[Command], obs: Mapping[str, Any]) -> list[Command]:
        """Evaluates the policies of all running skills, each once."""
        asking: dict[Decider, list[int]] = {}
        for row, command in enumerate(commands):
            if isinstance(command, PolicyCommand):
                asking.setdefault(command.turn.policy, []).append(row)
        for policy, rows in asking.items():
            turns = [_asked(commands[row]).turn for row in rows]
            policy.decide(rows, turns, obs)
        return [c.result() if isinstance(c, PolicyCommand) else c for c in commands]

    def report(self) -> list[AgentReport]:
        """Returns each row's failed stage, planning times and stages so far."""
        return [replace(report, failure=fault(report.trace)) for report in super().report()]


def _asked(command: Command) -> PolicyCommand:
    assert isinstance(command, PolicyCommand)
    return command
