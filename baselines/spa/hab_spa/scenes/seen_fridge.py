"""Scene of SPA's fridge skills: the fridge as it is seen and felt, besides the map (S App. D)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hab_spa.scenes.seen_scene import CAMERAS, SeenScene
from hab_spa.sensing.cloud import DepthView
from hab_spa.sensing.fridge_fit import LOWER_TOP_M, Found, Images, find_fridge, seen_joint
from hab_spa.sensing.known_fridge import (
    DOOR_NAME,
    WIDTH_M,
    articulation_of,
    bodies,
    hinges_of,
    poses_of,
)
from hab_spa.shapes import Array, box_distance_m, invert_pose
from hab_tasks.privileged import ArticulationState, CollisionBody, PrivilegedState
from hab_tasks.world.navigation import NavigationMap
from hab_tasks.world.scenes.floor import HIGHEST_M, LOWEST_M, floor_between

SEEN_M = 0.06
"""Surfaces so near to the fridge's shape are the fridge's: a door that swings is ahead of where it
is believed to be."""

SWEPT_RAD = 0.15
"""Angle of the door's thickness and of a lag of what is believed of it."""

CELL_M, AROUND_M = 0.05, 2.5
"""Side of the cells of the floor map, and how far it goes."""

LEAST_VOXELS = 4
"""A cell with fewer occupied voxels is free."""

REFIT_STEPS = 3
"""A door that the hand has let go is looked at in this interval."""


class SeenFridge(SeenScene):
    """A scene with a fridge that is found by its known shape; its door's opening is felt and seen.

    The hand can only hold the door's handle here.
    """

    def forget(self) -> None:
        """Starts a new episode."""
        super().forget()
        self._found: Found | None = None
        self._taken: tuple[float, float] | None = None
        self._age, self._widest_rad = 0, 0.0

    def see(self, obs: Mapping[str, Any], row: int) -> None:
        """Processes an observation; a held handle tells how far the door is open."""
        super().see(obs, row)
        self._age += 1
        if self._found is None or not self._was_holding:
            self._taken = None
            return
        x, y, _, joint = hinges_of(self._found.pose[None], self._found.side)[0]
        at_rad = np.arctan2(*(self._world_from_ee()[:2, 3] - (x, y))[::-1])
        if self._taken is None:
            self._taken = joint, at_rad
        began_rad, first_rad = self._taken
        turned_rad = np.angle(np.exp(1j * (at_rad - first_rad)))
        self._open_by(began_rad - self._found.side * turned_rad)

    @property
    def holding(self) -> bool:
        """Whether the hand holds an object: never."""
        return False

    def find(self, opened: bool) -> bool:
        """Looks for the fridge around the object; returns whether it is found, now or before."""
        self.look()
        base_m = self.world_from_base[:2, 3]
        found = find_fridge(self._images(), self.object_m(0), base_m, opened)
        if found is not None:
            self._found = found
            self._open_by(float(found.pose[3]))
        return self._found is not None

    def articulation(self, number: int) -> ArticulationState:
        """Returns the fridge's door."""
        if not self._was_holding and self._age >= REFIT_STEPS:
            self._age, joint = 0, seen_joint(self._images(), self._fridge)
            if joint is not None:
                self._open_by(joint)
        return articulation_of(self._fridge.pose, self._fridge.side, self._was_holding)

    def floor_map(self, joints: Mapping[int, float] | None = None) -> NavigationMap:
        """Returns the map of the floor between what was seen; unseen floor is free."""
        centres_m = self.map.occupied_m(self._shoulder_m, self.config.reach_m + AROUND_M)
        high = (centres_m[:, 2] > LOWEST_M) & (centres_m[:, 2] < HIGHEST_M)
        centres_m = centres_m[high & ~self._modeled(centres_m, SEEN_M)]
        cells = np.floor(centres_m[:, :2] / CELL_M)
        cells, counts = np.unique(cells, axis=0, return_counts=True)
        # A few pixels at an edge of the robot are not always told from what is behind it.
        cells = cells[counts >= LEAST_VOXELS] * CELL_M
        squares = cells[:, None] + CELL_M * np.array(((0, 0), (1, 0), (1, 1), (0, 1)))
        joint = (joints or {}).get(0, float(self._fridge.pose[3]))
        pose = np.append(self._fridge.pose[:3], joint)
        fridge = [
            outline for body, frame in self._bodies(pose) for outline in _footprints(body, frame)
        ]
        here_m = self.world_from_base[:2, 3]
        corners = here_m + AROUND_M * np.array(((-1.0, -1.0), (1.0, 1.0)))
        floor = floor_between([*squares, *fridge], corners)
        return NavigationMap(floor, np.zeros_like(floor.room))

    @property
    def _fridge(self) -> Found:
        assert self._found is not None, "the fridge was not found"
        return self._found

    def _open_by(self, joint: float) -> None:
        """Sets how far the door is believed to be open [rad]."""
        pose = np.append(self._fridge.pose[:3], max(joint, 0.0))
        self._found = replace(self._fridge, pose=pose)
        self._widest_rad = max(self._widest_rad, joint)

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

    def _bodies(self, pose: Array) -> list[tuple[CollisionBody, Array]]:
        """Returns the fridge's bodies and their poses (4, 4)."""
        frames = poses_of(pose, self._fridge.side)
        return [(body, frames[body.name]) for body in bodies(self._fridge.side)]

    def _articulations(self) -> tuple[ArticulationState, ...]:
        """Returns the fridge's door, once it was found."""
        if self._found is None:
            return ()
        return (articulation_of(self._found.pose, self._found.side, self._was_holding),)

    def _believed(self, without: str | None = None) -> PrivilegedState:
        """Returns the believed state of the robot and the fridge."""
        state = super()._believed(without)
        if self._found is None:
            return state
        found = [pair for pair in self._bodies(self._found.pose) if pair[0].name != without]
        return replace(
            state,
            scene_key=f"{state.scene_key} {self._found.side} {without == DOOR_NAME}",
            bodies=(*state.bodies, *(body for body, _ in found)),
            world_from_body={**state.world_from_body, **{b.name: pose for b, pose in found}},
        )

    def _modeled(self, points_m: Array, margin_m: float) -> NDArray[np.bool_]:
        """Whether world points (K, 3) are the fridge's."""
        near = super()._modeled(points_m, margin_m)
        if self._found is None or not len(points_m):
            return near
        for body, frame in self._bodies(self._found.pose):
            body_from_world = invert_pose(frame)
            local_m = points_m @ body_from_world[:3, :3].T + body_from_world[:3, 3]
            for shape in body.shapes:
                middle_m, half_m = shape.body_from_shape[:3, 3], shape.half_size_m
                gaps_m = box_distance_m(local_m, middle_m - half_m, middle_m + half_m)
                near |= gaps_m < max(SEEN_M, margin_m)
        return near | self._swept(points_m)

    def _swept(self, points_m: Array) -> NDArray[np.bool_]:
        """Whether points (K, 3) are where the door has moved, and so are of it or of nothing."""
        x, y, yaw, _ = hinges_of(self._fridge.pose[None], self._fridge.side)[0]
        gaps_m = points_m - (x, y, 0.0)
        along_m = self._fridge.side * (np.cos(yaw) * gaps_m[:, 1] - np.sin(yaw) * gaps_m[:, 0])
        out_m = np.cos(yaw) * gaps_m[:, 0] + np.sin(yaw) * gaps_m[:, 1]
        angles = np.arctan2(out_m, along_m)
        inside = np.hypot(out_m, along_m) < WIDTH_M + SEEN_M
        inside &= (points_m[:, 2] > LOWER_TOP_M) & (angles > 0.0)
        return inside & (angles < self._widest_rad + SWEPT_RAD)


def _footprints(body: CollisionBody, frame: Array) -> list[Array]:
    """Returns the outlines (4, 2) of a body's boxes on the floor."""
    corners = np.array(((-1, -1), (1, -1), (1, 1), (-1, 1)))
    return [
        (shape.body_from_shape[:2, 3] + corners * shape.half_size_m[:2]) @ frame[:2, :2].T
        + frame[:2, 3]
        for shape in body.shapes
    ]
