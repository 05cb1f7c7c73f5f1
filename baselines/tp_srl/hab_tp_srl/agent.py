"""TP+SRL's agent: executes a plan in each row, and evaluates policies for all rows together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from hab_plans.motion import Command
from hab_spa.agents.agent import SpaAgent

from hab_tasks.agent import AgentReport
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


def fault(trace: Sequence[dict[str, Any]]) -> str | None:
    """Returns the failure category of an episode: the first stage that was not achieved, and why.

    Args:
        trace: Trace of the robot; the last plan and each stage's last attempt count.

    Returns:
        E.g. ``pick timeout``, ``pick failed`` for a skill that ended without its effect, or
        ``navigate timeout``; with ``, new start`` if the skill began in a state that its training
        does not know. None if every stage was achieved.
    """
    tries = [entry for entry in trace if "stage" in entry]
    last = [entry for entry in tries if entry["plan"] == tries[-1]["plan"]]
    for place in sorted({entry["stage"] for entry in last}):
        here = [entry for entry in last if entry["stage"] == place]
        here = [entry for entry in here if entry["attempt"] == here[-1]["attempt"]]
        if here[-1].get("achieved"):
            continue
        for entry in here:
            outcome = entry.get("outcome", "timeout")
            if outcome != "done":
                return f"{entry['did']} {outcome}{_start_of(entry)}"
        return f"{here[-1]['did']} failed{_start_of(here[-1])}"
    return None


def _start_of(entry: Mapping[str, Any]) -> str:
    return ", new start" if entry.get("start") == "new" else ""
