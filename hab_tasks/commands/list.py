"""`hab-tasks list`: the table of environments."""

from __future__ import annotations

from hab_tasks.commands.options import List
from hab_tasks.envs import ENVS


def run(_options: List) -> int:
    """Prints the table."""
    for entry in ENVS.values():
        modes = ", ".join(entry.env.control_modes)
        print(f"{entry.id}: {entry.horizon_steps} steps; control {modes}")
        print(f"  {entry.env.summary()}")
        for item in entry.env.observation:
            shape = "x".join(map(str, item.shape))
            print(f"  {item.name:<20} {shape:>4}  {item.unit:<7} {item.meaning}")
    return 0
