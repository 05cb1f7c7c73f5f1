"""TidyHouse: five of thirty objects go from one open receptacle to another (S G.1, G.2)."""

from __future__ import annotations

from hab_tasks.receptacles import OPEN_RECEPTACLES
from hab_tasks.task_spec import Target, TaskSpec

TIDY_HOUSE = TaskSpec(
    id="HabTidyHouse-v1",
    instruction="Move five objects to their goal receptacles.",
    targets=tuple(
        Target(
            name=f"object_{number}",
            start=OPEN_RECEPTACLES,
            goal=OPEN_RECEPTACLES,
            stages=(f"pick_{number}", f"place_{number}"),
        )
        for number in range(1, 6)
    ),
    clutter=25,
    horizon_steps=5000,
)
