"""The benchmark's three tasks (S G.1, G.2)."""

from __future__ import annotations

from hab_tasks.receptacles import COUNTER, DRAWER, FRIDGE, OPEN_RECEPTACLES, TABLE_LIGHT
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
