"""Scene of SPA's Pick and Place: a fridge whose shape is known is found around what is in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hab_spa.scenes.seen_scene import CAMERAS, SeenScene
from hab_spa.sensing.cloud import DepthView
from hab_spa.sensing.fridge_fit import Found, Images, find_fridge
from hab_spa.sensing.known_fridge import BODY_NAME, SHELVES_M, bodies, poses_of
from hab_spa.shapes import Array, box_distance_m, invert_pose
from hab_tasks.arrays import Bools
from hab_tasks.privileged import CollisionBody, PrivilegedState

ON_LINE = 20
"""Points on a line of sight of 0.15 m at most; walls and shelves are 0.02 m thick."""

SURE_SCORE = 400.0
"""Least score of a fridge. In 160 episodes of Place in both scene datasets, all 21 fridges had 424
to 1132, and no other place was as high as their shelves."""


class SeenKnown(SeenScene):
    """A scene with bodies of known shape."""

    def _bodies(self) -> list[tuple[CollisionBody, Array]]:
        """Returns the bodies that were found, and their poses (4, 4)."""
        return []

    def _images(self) -> Images:
        """Returns the current images."""
        poses = self._own.poses(self.world_from_base, self.arm_qpos)
        views, own = [], []
        for camera in CAMERAS:
            view = DepthView.read(self._obs, camera, self._row)
            mine, seen = np.zeros(view.depth_m.shape, dtype=bool), np.isfinite(view.depth_m)
            mine[seen] = self._own.contain(view.points_m[seen], poses, self.config.own_margin_m)
            views.append(view)
            own.append(mine)
        return Images.of(views, own)

    def _believed(self, without: str | None = None) -> PrivilegedState:
        """Returns the believed state of the robot, the held object and the known bodies."""
        state = super()._believed(without)
        found = [pair for pair in self._bodies() if pair[0].name != without]
        shapes = [id(body) for body, _ in found]
        return replace(
            state,
            scene_key=f"{state.scene_key} {shapes}",
            bodies=(*state.bodies, *(body for body, _ in found)),
            world_from_body={**state.world_from_body, **{b.name: pose for b, pose in found}},
        )


class SeenShelves(SeenKnown):
    """A scene in which the walls and shelves of a fridge are known, though only parts are seen."""

    def forget(self) -> None:
        """Starts a new episode."""
        super().forget()
        self._around: Found | None = None

    def look_into(self, place_m: Array) -> None:
        """Looks for a fridge around a place (3,), if it is as high as the shelves."""
        low_m, high_m = SHELVES_M
        if self._around is None and low_m < place_m[2] < high_m:
            found = find_fridge(self._images(), place_m, self.world_from_base[:2, 3], opened=True)
            if found is not None and found.score >= SURE_SCORE:
                self._around = found

    def grasp_points_m(self, number: int, *, around: bool = False) -> Array:
        """Returns the points (P, 3) at which the hand can grasp an object, on its side of walls."""
        points_m = super().grasp_points_m(number, around=around)
        for body, frame in self._bodies():
            points_m = points_m[~are_parted(points_m, self.object_m(number), body, frame)]
        return points_m

    def _bodies(self) -> list[tuple[CollisionBody, Array]]:
        """Returns the fridge without its door, which is seen."""
        if self._around is None:
            return []
        body, _ = bodies(self._around.side)
        return [(body, poses_of(self._around.pose, self._around.side)[BODY_NAME])]


def are_parted(points_m: Array, object_m: Array, body: CollisionBody, frame: Array) -> Bools:
    """Whether the boxes of a body at (4, 4) are between points (P, 3) and an object at (3,)."""
    shares = np.linspace(0.0, 1.0, ON_LINE)[:, None, None]
    lines_m = points_m + shares * (object_m - points_m)
    parted = np.zeros(len(points_m), dtype=bool)
    for shape in body.shapes:
        box_from_world = invert_pose(frame @ shape.body_from_shape)
        local_m = lines_m @ box_from_world[:3, :3].T + box_from_world[:3, 3]
        inside = box_distance_m(local_m, -shape.half_size_m, shape.half_size_m) == 0.0
        parted |= inside.any(axis=0)
    return parted
