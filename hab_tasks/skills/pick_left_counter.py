"""The simplified Pick of S F.2: five objects on the left counter, the robot facing the wall.

Made by ``gym.make("hab_tasks.skills.pick_left_counter:HabPickLeftCounter-v1")``. The skill is Pick;
only the start states differ.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from hab_tasks.constants import SKILL_HORIZON_STEPS
from hab_tasks.episodes.robot_start import RobotStarts, StartNoise
from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.schema import Episode, RobotStart
from hab_tasks.episodes.spots import Spot
from hab_tasks.errors import RejectedSampleError
from hab_tasks.geometry import Array
from hab_tasks.receptacles import COUNTER_LEFT
from hab_tasks.registration import register_skill
from hab_tasks.skills.pick import PICK, HabPickEnv, PickStarts

COUNT = 5
"""Number of objects; one of them is the target."""


class LeftCounterStarts(PickStarts):
    """Five objects on the left counter; the base at the counter, with normal noise (S F.2)."""

    receptacles = (COUNTER_LEFT,)
    clutter = (COUNT - 1, COUNT - 1)
    noise = StartNoise(base_m=0.5, heading_rad=0.15, ee_m=0.05, candidates=60)

    def attempt(self, sandbox: PlacementSandbox, rng: np.random.Generator) -> Episode:
        """Returns one candidate."""
        episode = super().attempt(sandbox, rng)
        if len(episode.objects) < COUNT:
            raise RejectedSampleError(f"fewer than {COUNT} objects rest on the counter")
        return episode

    def robot_start(
        self, starts: RobotStarts, sandbox: PlacementSandbox, spot: Spot, target_m: Array
    ) -> RobotStart:
        """Returns a start around the free floor nearest to the counter, facing the wall."""
        noise, middle = self.noise, spot.center_m
        near = sandbox.floor().cells_around(
            middle, noise.clearance_m, noise.nearest_m, noise.farthest_m
        )
        if not len(near):
            raise RejectedSampleError("no free floor near the counter")
        # The shorter axis of the counter points to the wall.
        ahead = spot.axes[:2, int(np.argmin(spot.half_m))]
        ahead = ahead * np.sign(ahead @ (middle[:2] - near[0]))
        return starts.around(near[0], math.atan2(ahead[1], ahead[0]), target_m)


class HabPickLeftCounterEnv(HabPickEnv):
    """`HabPickEnv` with the start states of S F.2: the left counter, five objects, normal noise."""

    skill = replace(PICK, starts=LeftCounterStarts)


register_skill("HabPickLeftCounter-v1", f"{__name__}:HabPickLeftCounterEnv", SKILL_HORIZON_STEPS)
