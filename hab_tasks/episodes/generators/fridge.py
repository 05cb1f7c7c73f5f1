"""Start states of Open and Close fridge (S H.2): the robot in a rectangle before the fridge."""

from __future__ import annotations

import math

import numpy as np

from hab_tasks.episodes.generators.base import Generator, open_joints, put_all, stage, start_state
from hab_tasks.episodes.generators.furniture import find_front, handles_m, level_frame
from hab_tasks.episodes.placing import Placer
from hab_tasks.episodes.receptacles import FRIDGE
from hab_tasks.episodes.refusal import RefusedError
from hab_tasks.episodes.robot_start import KeepOff, Rectangle
from hab_tasks.episodes.schema import Episode, Rearrangement
from hab_tasks.episodes.workbench import Workbench

FRIDGE_MARKER = "fridge_push_point"

SPAWN_REGION = Rectangle(x_m=(0.933, 1.833), y_m=(-0.6, 0.6))
"""0.9 m x 1.2 m in the fridge's frame (S H.2); the distance from the fridge is M3's."""

MOST_IN_FRIDGE = 3


class OpenFridge(Generator):
    """The door closed, the target behind it."""

    open_rad: tuple[float, float] = (0.0, 0.0)

    def attempt(self, bench: Workbench, rng: np.random.Generator) -> Episode:
        """Returns one candidate."""
        (spot,) = self.spots(bench, (FRIDGE,))[:1]
        front = find_front(bench, FRIDGE_MARKER)
        handles = self.draw(rng, int(rng.integers(1, MOST_IN_FRIDGE + 1)))
        bench.show(handles)
        open_joints(bench, spot.joints)
        placer = Placer(bench, rng, self.settling)
        put_all(placer, handles, [spot])
        objects = placer.settle()
        if not objects:
            raise RefusedError("nothing rests on the receptacle")
        target = list(objects)[int(rng.integers(len(objects)))]
        angle = round(float(rng.uniform(*self.open_rad)), 6)
        stage(bench, objects, {front.ref.furniture: {front.ref.joint: angle}})
        if bench.touching(f"{front.ref.furniture}/{front.marker.link}"):
            raise RefusedError("the door meets something")
        root = bench.world_from(f"{front.ref.furniture}/{bench.root_of(front.ref.furniture)}")
        robot = self.starts(bench, rng, KeepOff(points_m=handles_m(bench))).in_rectangle(
            level_frame(root[:3, 3], root[:3, 0]), SPAWN_REGION, front.handle_m(bench), reach=False
        )
        rearrangement = Rearrangement(object=target, start=spot.ref)
        return start_state(bench, robot, objects, (rearrangement,), handle=front.ref)


class CloseFridge(OpenFridge):
    """The door open between pi/4 and 2 pi/3."""

    open_rad = (math.pi / 4, 2 * math.pi / 3)
