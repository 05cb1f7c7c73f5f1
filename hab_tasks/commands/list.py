"""`hab-tasks list`: the table of environments."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from hab_tasks.console import Command


@dataclass(frozen=True, kw_only=True)
class List(Command):
    """Options of `hab-tasks list`."""

    help: ClassVar[
        str
    ] = """Lists the environments: id, horizon, control modes, summary, observation entries.

Example:
  hab-tasks list"""

    def run(self) -> int:
        """Prints the table."""
        from hab_tasks.envs import ENVS

        for entry in ENVS.values():
            modes = ", ".join(entry.env.control_modes)
            print(f"{entry.id}: {entry.horizon_steps} steps; control {modes}")
            print(f"  {entry.env.summary()}")
            for item in entry.env.observation:
                shape = "x".join(map(str, item.shape))
                print(f"  {item.name:<20} {shape:>4}  {item.unit:<7} {item.meaning}")
        return 0
