"""PrepareGroceries: two objects out of the open fridge, one from the counter into it (S G.2)."""

from __future__ import annotations

from hab_tasks.receptacles import COUNTER, FRIDGE, OPEN_RECEPTACLES, TABLE_LIGHT
from hab_tasks.task_spec import Target, TaskSpec

PREPARE_GROCERIES = TaskSpec(
    id="HabPrepareGroceries-v1",
    instruction=(
        "Move two objects from the fridge to counter and table, and one from counter to fridge."
    ),
    targets=(
        Target(
            name="from_fridge_1",
            start=(FRIDGE,),
            goal=COUNTER,
            stages=("pick_fridge_1", "place_counter"),
        ),
        Target(
            name="from_fridge_2",
            start=(FRIDGE,),
            goal=(TABLE_LIGHT,),
            stages=("pick_fridge_2", "place_table"),
        ),
        Target(
            name="to_fridge", start=COUNTER, goal=(FRIDGE,), stages=("pick_counter", "place_fridge")
        ),
    ),
    starts_open=("fridge", "drawer"),
    clutter=27,
    clutter_on=(*OPEN_RECEPTACLES, FRIDGE),
    horizon_steps=4000,
)
