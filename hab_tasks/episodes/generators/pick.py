"""Start states of Pick (S H.2): objects settled on a receptacle, the robot facing the target."""

from __future__ import annotations

import numpy as np

from hab_tasks.episodes.generators.base import (
    Generator,
    open_joints,
    put_all,
    stage,
    start_state,
)
from hab_tasks.episodes.placing import Placer
from hab_tasks.episodes.receptacles import PICK_RECEPTACLES
from hab_tasks.episodes.refusal import RefusedError
from hab_tasks.episodes.robot_start import KeepOff
from hab_tasks.episodes.schema import Episode, Rearrangement
from hab_tasks.episodes.workbench import Workbench

CLUTTER = (2, 5)
"""Fewest and most objects beside the target."""


class Pick(Generator):
    """A target and clutter on one of the six receptacles."""

    def attempt(self, bench: Workbench, rng: np.random.Generator) -> Episode:
        """Returns one candidate."""
        spots = self.spots(bench, self.objects.receptacles or PICK_RECEPTACLES)
        spot = spots[int(rng.integers(len(spots)))]
        handles = self.draw(rng, 1 + int(rng.integers(CLUTTER[0], CLUTTER[1] + 1)))
        bench.show(handles)
        open_joints(bench, spot.joints)
        placer = Placer(bench, rng, self.settling)
        if not put_all(placer, handles, [spot]):
            raise RefusedError("no room on the receptacle")
        objects = placer.settle()
        if not objects:
            raise RefusedError("nothing rests on the receptacle")
        target = list(objects)[int(rng.integers(len(objects)))]
        stage(bench, objects, spot.joints)
        # Of the other objects as well: one that is taken first ends the episode.
        keep_off = KeepOff(points_m=bench.graspable_m())
        robot = self.starts(bench, rng, keep_off).facing(bench.com_m(target))
        return start_state(bench, robot, objects, (Rearrangement(object=target, start=spot.ref),))
