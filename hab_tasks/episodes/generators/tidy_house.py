"""TidyHouse: five of thirty objects go from one open receptacle to another."""

from __future__ import annotations

from hab_tasks.episodes.generators.rearrange import Move, Rearrange
from hab_tasks.episodes.receptacles import OPEN_RECEPTACLES


class TidyHouse(Rearrange):
    """Everything closed; nothing has to be opened."""

    moves = 5 * (Move(start=OPEN_RECEPTACLES, goal=OPEN_RECEPTACLES),)
    clutter = 25
    clutter_on = OPEN_RECEPTACLES
    starts_open = False
