"""Start states of Open and Close drawer (S H.2): the robot in a rectangle before the drawer."""

from __future__ import annotations

import numpy as np

from hab_tasks.episodes.generators.base import Generator, open_joints, put_all, stage, start_state
from hab_tasks.episodes.generators.furniture import (
    Front,
    find_front,
    handles_m,
    level_frame,
    other_drawers,
)
from hab_tasks.episodes.placing import Placer
from hab_tasks.episodes.receptacles import DRAWER
from hab_tasks.episodes.refusal import RefusedError
from hab_tasks.episodes.robot_start import KeepOff, Rectangle
from hab_tasks.episodes.schema import POSE_DIGITS, Episode, Rearrangement, rounded
from hab_tasks.episodes.workbench import Workbench
from hab_tasks.geometry import Pose7, from_matrix, to_matrix

DRAWER_MARKER = "cab_push_point_5"
"""The right top drawer of the kitchen counter, Habitat's choice."""

SPAWN_REGION = Rectangle(x_m=(0.80, 0.95), y_m=(-0.375, 0.375))
"""0.15 m x 0.75 m before the drawer's own frame (S H.2); the distance is Habitat's."""

OTHERS_OPEN = 0.5
"""Chance of each of the other drawers to be open, by 0 to 100 % of its travel."""

HEADROOM_M = 0.002
"""Free space left above what lies in a drawer: pushed, it tilts a little."""

STATIONS = 11
"""At so many positions along its travel a drawer is tested; nothing tall is as thin as a step."""


class OpenDrawer(Generator):
    """The drawer closed, the target in it, a random subset of the others open."""

    open_share: tuple[float, float] = (0.0, 0.0)

    def attempt(self, bench: Workbench, rng: np.random.Generator) -> Episode:
        """Returns one candidate."""
        (spot,) = self.spots(bench, (DRAWER,))[:1]
        front = find_front(bench, DRAWER_MARKER)
        handles = self.draw(rng, 1)
        bench.show(handles)
        open_joints(bench, spot.joints)
        placer = Placer(bench, rng, self.settling)
        put_all(placer, handles, [spot])
        objects = placer.settle()
        if not objects:
            raise RefusedError("nothing rests on the receptacle")
        if not slides(bench, objects, front):
            raise RefusedError("the drawer cannot be moved with the object")
        travel_m = bench.joint_limits(front.ref.furniture, front.ref.joint)[1]
        joints = self._other_joints(bench, rng, front)
        position = round(travel_m * float(rng.uniform(*self.open_share)), POSE_DIGITS)
        objects = carried(bench, objects, front, position)
        stage(bench, objects, {front.ref.furniture: {front.ref.joint: position, **joints}})
        if any(bench.touching(handle) for handle in objects):
            raise RefusedError("the drawer cannot be closed over the object")
        link = bench.world_from(f"{front.ref.furniture}/{front.marker.link}")
        robot = self.starts(bench, rng, KeepOff(points_m=handles_m(bench))).in_rectangle(
            level_frame(link[:3, 3], link[:3, 0]), SPAWN_REGION, front.handle_m(bench), reach=True
        )
        rearrangement = Rearrangement(object=handles[0], start=spot.ref)
        return start_state(bench, robot, objects, (rearrangement,), handle=front.ref)

    def _other_joints(
        self, bench: Workbench, rng: np.random.Generator, front: Front
    ) -> dict[str, float]:
        joints = {}
        for joint in other_drawers(bench, front):
            draw = rng.uniform(size=2)
            if draw[0] < OTHERS_OPEN:
                travel_m = bench.joint_limits(front.ref.furniture, joint)[1]
                joints[joint] = round(travel_m * float(draw[1]), POSE_DIGITS)
        return joints


class CloseDrawer(OpenDrawer):
    """The drawer open by 80 to 100 % of its travel."""

    open_share = (0.8, 1.0)


def slides(bench: Workbench, objects: dict[str, Pose7], front: Front) -> bool:
    """Whether a drawer can be moved all the way with what lies in it, the furniture as it stands.

    All of `objects` are in it; they and the drawer are put back.
    """
    low_m, high_m = bench.joint_limits(front.ref.furniture, front.ref.joint)
    before = bench.joints().get(front.ref.furniture, {}).get(front.ref.joint, 0.0)
    free, poses = True, objects
    for position in np.linspace(low_m, high_m, STATIONS):
        poses = carried(bench, poses, front, float(position))
        for handle, pose in poses.items():
            bench.place(handle, (*pose[:2], pose[2] + HEADROOM_M, *pose[3:]))
        free = free and not any(bench.touching(handle) for handle in objects)
    bench.set_joint(front.ref.furniture, front.ref.joint, before)
    for handle, pose in objects.items():
        bench.place(handle, pose)
    return free


def carried(
    bench: Workbench, objects: dict[str, Pose7], front: Front, position: float
) -> dict[str, Pose7]:
    """Moves a drawer [m]; returns where the objects in it are then. All of `objects` are in it."""
    link = f"{front.ref.furniture}/{front.marker.link}"
    before = bench.world_from(link)
    bench.set_joint(front.ref.furniture, front.ref.joint, position)
    moved = bench.world_from(link) @ np.linalg.inv(before)
    return {
        handle: rounded(from_matrix(moved @ to_matrix(pose))) for handle, pose in objects.items()
    }
