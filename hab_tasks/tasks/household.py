"""Tasks that HAB lacks, with its skills.

Made by ``gym.make("hab_tasks.tasks.household:HabClearAll-v1")``; likewise ``HabServeDrink-v1``.
"""

from __future__ import annotations

from hab_tasks.receptacles import COUNTER, FRIDGE, OPEN_RECEPTACLES, SINK, SOFA, TABLE_LIGHT
from hab_tasks.registration import register_task
from hab_tasks.task_spec import Target, TaskSpec

CLEAR_ALL = TaskSpec(
    id="HabClearAll-v1",
    instruction="Clear the sofa: put everything on it where it belongs.",
    targets=(
        Target(name="dish", objects=("dish",), start=(SOFA,), goal=(SINK,)),
        Target(name="can", objects=("can",), start=(SOFA,), goal=COUNTER),
        Target(name="box", objects=("box",), start=(SOFA,), goal=(TABLE_LIGHT,)),
        Target(name="fruit", objects=("fruit",), start=(SOFA,), goal=(FRIDGE,)),
    ),
    ends_closed=("fridge",),
    clutter=20,
    clutter_on=tuple(name for name in OPEN_RECEPTACLES if name != SOFA),
    horizon_steps=6000,
)

SERVE_DRINK = TaskSpec(
    id="HabServeDrink-v1",
    instruction="Put a mug on the table, then a can from the fridge, and close the fridge.",
    targets=(
        Target(name="mug", objects=("025_mug",), start=COUNTER, goal=(TABLE_LIGHT,)),
        Target(name="drink", objects=("can",), start=(FRIDGE,), goal=(TABLE_LIGHT,)),
    ),
    ends_closed=("fridge",),
    clutter=20,
    clutter_on=(*OPEN_RECEPTACLES, FRIDGE),
    horizon_steps=3500,
)

for _task in (CLEAR_ALL, SERVE_DRINK):
    register_task(_task, __name__)
