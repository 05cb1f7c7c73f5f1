"""PrepareGroceries: two objects out of the fridge, to counter and table, one into it (S G.2)."""

from __future__ import annotations

from hab_tasks.episodes.generators.rearrange import Move, Rearrange
from hab_tasks.episodes.receptacles import COUNTER, FRIDGE, OPEN_RECEPTACLES, TABLE_LIGHT


class PrepareGroceries(Rearrange):
    """Fridge and drawer start open."""

    moves = (
        Move(start=(FRIDGE,), goal=COUNTER),
        Move(start=(FRIDGE,), goal=(TABLE_LIGHT,)),
        Move(start=COUNTER, goal=(FRIDGE,)),
    )
    clutter = 27
    clutter_on = (*OPEN_RECEPTACLES, FRIDGE)
    starts_open = True
