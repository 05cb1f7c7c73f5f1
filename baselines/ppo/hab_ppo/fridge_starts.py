"""Environments for training with start states at the fridge that skills rarely or never have.

Pick and Place begin there in half of their episodes; of the benchmark's start states one in six or
seven is there. They are the hardest, and two of the three tasks need them. Open fridge begins in
half of its episodes in a corner of its region, where one step ahead can leave it; of the
benchmark's start states one in five is there, in layouts with an obstacle on one side of the fridge
more. Close fridge begins with the door open up to its limit, as Open fridge leaves it in a task;
the benchmark's start states have 2 pi/3 at most. The environments are otherwise those of the
skills.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from hab_tasks.articulations import Rectangle
from hab_tasks.constants import SKILL_HORIZON_STEPS
from hab_tasks.episodes.generators.base import Generator
from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.spots import Spot
from hab_tasks.receptacles import FRIDGE
from hab_tasks.registration import register_skill
from hab_tasks.skills.close_fridge import CLOSE_FRIDGE, CloseFridgeStarts, HabCloseFridgeEnv
from hab_tasks.skills.open_fridge import OPEN_FRIDGE, HabOpenFridgeEnv, OpenFridgeStarts
from hab_tasks.skills.pick import PICK, HabPickEnv, PickStarts
from hab_tasks.skills.place import PLACE, HabPlaceEnv, PlaceStarts

PICK_ID = "PickOftenFromFridge-v1"
PLACE_ID = "PlaceOftenInFridge-v1"
OPEN_ID = "OpenFridgeFromCorners-v1"
CLOSE_ID = "CloseWideOpenFridge-v1"

FRIDGE_SHARE = 0.5
"""Share of the start states at the fridge, beside those that have it by chance."""

CORNER_SHARE = 0.5
"""Share of the start states of Open fridge in a corner, beside those that are there by chance."""

CORNER_X_M, CORNER_Y_M = 0.32, 0.3
"""Size of the two corners of the region that are next to the fridge."""


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


class OpenFromCornersStarts(OpenFridgeStarts):
    """Start states of Open fridge, half of them in a corner of the region next to the fridge."""

    def draw_region(self, rng: np.random.Generator) -> Rectangle:
        """See `OpenFridgeStarts.draw_region`."""
        if rng.uniform() >= CORNER_SHARE:
            return self.region
        (x_m, _), (least_m, most_m) = self.region.x_m, self.region.y_m
        sides = ((least_m, least_m + CORNER_Y_M), (most_m - CORNER_Y_M, most_m))
        return Rectangle(x_m=(x_m, x_m + CORNER_X_M), y_m=sides[int(rng.integers(2))])


class CloseWideOpenStarts(CloseFridgeStarts):
    """Start states of Close fridge, the door open between pi/4 and its limit."""

    open_rad = (math.pi / 4, 2.3)


class PickOftenFromFridgeEnv(HabPickEnv):
    """`HabPickEnv`, in half of the episodes from the fridge."""

    skill = replace(PICK, starts=PickOftenStarts)


class PlaceOftenInFridgeEnv(HabPlaceEnv):
    """`HabPlaceEnv`, in half of the episodes into the fridge."""

    skill = replace(PLACE, starts=PlaceOftenStarts)


class OpenFridgeFromCornersEnv(HabOpenFridgeEnv):
    """`HabOpenFridgeEnv`, in half of the episodes from a corner of the region."""

    skill = replace(OPEN_FRIDGE, starts=OpenFromCornersStarts)


class CloseWideOpenFridgeEnv(HabCloseFridgeEnv):
    """`HabCloseFridgeEnv`, with the door open up to its limit."""

    skill = replace(CLOSE_FRIDGE, starts=CloseWideOpenStarts)


register_skill(PICK_ID, f"{__name__}:PickOftenFromFridgeEnv", SKILL_HORIZON_STEPS)
register_skill(PLACE_ID, f"{__name__}:PlaceOftenInFridgeEnv", SKILL_HORIZON_STEPS)
register_skill(OPEN_ID, f"{__name__}:OpenFridgeFromCornersEnv", SKILL_HORIZON_STEPS)
register_skill(CLOSE_ID, f"{__name__}:CloseWideOpenFridgeEnv", SKILL_HORIZON_STEPS)
