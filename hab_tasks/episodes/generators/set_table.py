"""SetTable: the bowl from the closed drawer to the table, the apple from the fridge into it."""

from __future__ import annotations

from hab_tasks.episodes.generators.rearrange import Move, Rearrange
from hab_tasks.episodes.receptacles import DRAWER, FRIDGE, OPEN_RECEPTACLES, TABLE_LIGHT


class SetTable(Rearrange):
    """Fridge and drawer start closed."""

    moves = (
        Move(object="024_bowl", start=(DRAWER,), goal=(TABLE_LIGHT,)),
        Move(object="013_apple", start=(FRIDGE,), into=0),
    )
    clutter = 27
    clutter_on = (*OPEN_RECEPTACLES, FRIDGE)
    starts_open = False
