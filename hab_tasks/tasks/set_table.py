"""SetTable: the bowl from the drawer to the table, the apple from the fridge into it (S G.2)."""

from __future__ import annotations

from hab_tasks.receptacles import DRAWER, FRIDGE, OPEN_RECEPTACLES, TABLE_LIGHT
from hab_tasks.task_spec import Target, TaskSpec

SET_TABLE = TaskSpec(
    id="HabSetTable-v1",
    instruction=(
        "Put the bowl from the drawer on the table, and the apple from the fridge into the bowl."
    ),
    targets=(
        Target(name="bowl", objects=("024_bowl",), start=(DRAWER,), goal=(TABLE_LIGHT,)),
        Target(name="apple", objects=("013_apple",), start=(FRIDGE,), inside="bowl"),
    ),
    ends_closed=("drawer", "fridge"),
    clutter=27,
    clutter_on=(*OPEN_RECEPTACLES, FRIDGE),
    horizon_steps=4500,
)
