"""A user-defined task, as in the README."""

from hab_tasks import Target, TaskSpec, receptacles, register_task

TABLE = (receptacles.TABLE_LIGHT,)
CLEAR_TABLE = TaskSpec(
    id="ClearTable-v1",
    instruction="Clear the table: the fruit into the fridge, the dish to the counter.",
    targets=(
        Target(name="fruit", objects=("fruit",), start=TABLE, goal=(receptacles.FRIDGE,)),
        Target(name="dish", objects=("dish",), start=TABLE, goal=receptacles.COUNTER),
    ),
    ends_closed=("fridge",),
    horizon_steps=3000,
)
register_task(CLEAR_TABLE, __name__)
