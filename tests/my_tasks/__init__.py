"""A user-defined task, as in the README."""

from hab_tasks import Target, TaskSpec, register_task
from hab_tasks.receptacles import COUNTER, FRIDGE, TABLE_LIGHT

CLEAR_TABLE = TaskSpec(
    id="ClearTable-v1",
    instruction="Clear the table: the fruit into the fridge, the dish to the counter.",
    targets=(
        Target(name="fruit", objects=("fruit",), start=(TABLE_LIGHT,), goal=(FRIDGE,)),
        Target(name="dish", objects=("dish",), start=(TABLE_LIGHT,), goal=COUNTER),
    ),
    ends_closed=("fridge",),
    horizon_steps=3000,
)
register_task(CLEAR_TABLE, __name__)
