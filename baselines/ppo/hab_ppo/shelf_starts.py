"""An environment for training Pick with start states at shelves, which the benchmark holds out.

Half of the episodes are at the narrow shelves, where no board is within 5 cm of the height of a
held-out one. Layouts in which they hang at other heights than usual:
``hab-tasks vary apartment --wild --extend train --shelves --count 100 --out DIR``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hab_tasks.constants import SKILL_HORIZON_STEPS
from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.spots import Spot, receptacles_named, spot_of
from hab_tasks.receptacles import CABINET, SHELVES
from hab_tasks.registration import register_skill
from hab_tasks.skills.pick import PICK, HabPickEnv, PickStarts

PICK_ID = "PickOftenFromShelves-v1"

SHELF_SHARE = 0.5
"""Share of the start states at shelves, in layouts that have raised ones."""

APART_M = 0.05
"""Least difference to the height of a held-out shelf."""


class PickOftenStarts(PickStarts):
    """Start states of Pick, half of them at shelves that are not held out."""

    def draw_spot(
        self, sandbox: PlacementSandbox, rng: np.random.Generator, names: tuple[str, ...]
    ) -> Spot:
        """See `Generator.draw_spot`."""
        if rng.uniform() >= SHELF_SHARE:
            return super().draw_spot(sandbox, rng, names)
        held_out = receptacles_named(sandbox, SHELVES)
        heights_m = np.array([spot_of(sandbox, one, {}).center_m[2] for one in held_out])
        others = [
            spot
            for spot in self.spots(sandbox, CABINET)
            if np.abs(heights_m - spot.center_m[2]).min(initial=np.inf) > APART_M
        ]
        if not others:
            return super().draw_spot(sandbox, rng, names)
        return others[int(rng.integers(len(others)))]


class PickOftenFromShelvesEnv(HabPickEnv):
    """`HabPickEnv`, in half of the episodes from shelves."""

    skill = replace(PICK, starts=PickOftenStarts)


register_skill(PICK_ID, f"{__name__}:PickOftenFromShelvesEnv", SKILL_HORIZON_STEPS)
