"""Pick among near objects, for training.

The hand snaps to the nearest object within 0.15 m, and a blind policy does not observe which one
that is: where objects stand close together, it must bring the hand nearer to the target than the
benchmark's start states demand.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hab_ppo.fridge_starts import PickOftenStarts
from hab_tasks.constants import SKILL_HORIZON_STEPS
from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.registration import register_skill
from hab_tasks.skills.pick import PICK, HabPickEnv

ENV_ID = "PickCrowded-v1"


class CrowdedStarts(PickOftenStarts):
    """Start states of Pick with more clutter, often from the fridge."""

    clutter = (4, 9)

    def target_of(
        self, objects: list[str], sandbox: PlacementSandbox, rng: np.random.Generator
    ) -> str:
        """Returns the object with the nearest neighbour, or in one of three episodes any."""
        if len(objects) < 2 or rng.uniform() < 1 / 3:
            return super().target_of(objects, sandbox, rng)
        places_m = np.array([sandbox.com_m(name) for name in objects])
        gaps_m = np.linalg.norm(places_m[:, None] - places_m, axis=-1)
        np.fill_diagonal(gaps_m, np.inf)
        return objects[int(gaps_m.min(axis=1).argmin())]


class PickCrowdedEnv(HabPickEnv):
    """`HabPickEnv` among more and nearer objects, often from the fridge."""

    skill = replace(PICK, starts=CrowdedStarts)


register_skill(ENV_ID, f"{__name__}:PickCrowdedEnv", SKILL_HORIZON_STEPS)
