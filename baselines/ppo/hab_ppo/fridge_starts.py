"""Environments for training with start states at the fridge that skills rarely or never have.

Pick and Place begin there in half of their episodes; of the benchmark's start states one in six or
seven is there. They are the hardest, and two of the three tasks need them. Close fridge begins with
the door open up to its limit, as Open fridge leaves it in a task; the benchmark's start states have
2 pi/3 at most. The environments are otherwise those of the skills.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from hab_tasks.constants import SKILL_HORIZON_STEPS
from hab_tasks.episodes.generators.base import Generator
from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.spots import Spot
from hab_tasks.receptacles import FRIDGE
from hab_tasks.registration import register_skill
from hab_tasks.skills.close_fridge import CLOSE_FRIDGE, CloseFridgeStarts, HabCloseFridgeEnv
from hab_tasks.skills.pick import PICK, HabPickEnv, PickStarts
from hab_tasks.skills.place import PLACE, HabPlaceEnv, PlaceStarts

PICK_ID = "PickOftenFromFridge-v1"
PLACE_ID = "PlaceOftenInFridge-v1"
CLOSE_ID = "CloseWideOpenFridge-v1"

FRIDGE_SHARE = 0.5
"""Share of the start states at the fridge, beside those that have it by chance."""


class _OftenFridge(Generator):
    """A generator that takes the fridge more often than other receptacles."""

    def draw_spot(
        self, sandbox: PlacementSandbox, rng: np.random.Generator, names: tuple[str, ...]
    ) -> Spot:
        """See `Generator.draw_spot`."""
        often = rng.uniform() < FRIDGE_SHARE
        return super().draw_spot(sandbox, rng, (FRIDGE,) if often else names)


class PickOftenStarts(_OftenFridge, PickStarts):
    """Start states of Pick, half of them at the fridge."""


class PlaceOftenStarts(_OftenFridge, PlaceStarts):
    """Start states of Place, half of them at the fridge."""


class CloseWideOpenStarts(CloseFridgeStarts):
    """Start states of Close fridge, the door open between pi/4 and its limit."""

    open_rad = (math.pi / 4, 2.3)


class PickOftenFromFridgeEnv(HabPickEnv):
    """`HabPickEnv`, in half of the episodes from the fridge."""

    skill = replace(PICK, starts=PickOftenStarts)


class PlaceOftenInFridgeEnv(HabPlaceEnv):
    """`HabPlaceEnv`, in half of the episodes into the fridge."""

    skill = replace(PLACE, starts=PlaceOftenStarts)


class CloseWideOpenFridgeEnv(HabCloseFridgeEnv):
    """`HabCloseFridgeEnv`, with the door open up to its limit."""

    skill = replace(CLOSE_FRIDGE, starts=CloseWideOpenStarts)


register_skill(PICK_ID, f"{__name__}:PickOftenFromFridgeEnv", SKILL_HORIZON_STEPS)
register_skill(PLACE_ID, f"{__name__}:PlaceOftenInFridgeEnv", SKILL_HORIZON_STEPS)
register_skill(CLOSE_ID, f"{__name__}:CloseWideOpenFridgeEnv", SKILL_HORIZON_STEPS)
