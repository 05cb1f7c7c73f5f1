"""Failure category of an episode, from the trace of its plan."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any


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
