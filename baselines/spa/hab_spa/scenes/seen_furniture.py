"""Scenes of SPA's fridge and drawer skills: furniture as it is seen and felt (S App. D)."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hab_spa.scenes.seen_scene import LEAST_VOXELS
from hab_spa.scenes.seen_shelves import SeenKnown
from hab_spa.sensing.drawer_fit import HALF_WIDTH_M, TRAVEL_M, FoundDrawer, find_drawer
from hab_spa.sensing.fridge_fit import LOWER_TOP_M, Found, Images, find_fridge, refined, seen_joint
from hab_spa.sensing.known_fridge import (
    MOST_RAD,
    WIDTH_M,
    articulation_of,
    bodies,
    box_body,
    hinges_of,
    poses_of,
)
from hab_spa.sensing.walls import supposed_walls
from hab_spa.shapes import Array, box_distance_m, invert_pose
from hab_tasks.constants import REST_RADIUS_M
from hab_tasks.privileged import ArticulationState, CollisionBody
from hab_tasks.world.navigation import NavigationMap
from hab_tasks.world.scenes.floor import HIGHEST_M, LOWEST_M, floor_between

SEEN_M = 0.06
"""Surfaces so near to the fridge's shape are the fridge's: a door that swings is ahead of where it
is believed to be."""

SWEPT_RAD = 0.15
"""Angle of the door's thickness and of a lag of what is believed of it."""

CELL_M, AROUND_M = 0.05, 2.5
"""Side of the cells of the floor map, and how far it goes."""

REFIT_STEPS = 3
"""A door that the hand has let go is looked at in this interval."""

ELSEWHERE, MOST_LOOKS = 0.2, 6
"""So many looks at a door that nobody has moved count together, each from a head camera that has
moved by so much [m], or turned by so much [rad], since the one before."""

AS_FELT_RAD, PUSHED_RAD = np.array((-0.15, 0.5)), np.array((-0.6, 0.5))
"""A door that was opened stands where the hand let it go, or has been pushed farther; also back,
if the arm has met something since."""

DRAWER_HALF_M, HANDLE_M = 0.097, 0.1
"""Half of a drawer's height, and how far its handle stands out."""

DRAWER = box_body(
    "seen_drawer",
    (
        ((-0.04, 0.0, 0.0), (0.03, 2 * HALF_WIDTH_M, 2 * DRAWER_HALF_M)),
        ((-0.3, 0.0, -0.075), (0.55, 0.82, 0.02)),
        ((-0.3, -0.405, -0.01), (0.55, 0.02, 0.12)),
        ((-0.3, 0.405, -0.01), (0.55, 0.02, 0.12)),
    ),
)
"""The drawer's front, floor and sides, in the frame of its handle."""

BESIDE_M = (0.0, 0.14, -0.14, 0.26, -0.26)
"""Where its handle is tried, beside where it is believed: the hand takes one within 0.15 m."""

REACHED_M = 0.08
"""A hand that is farther from it has not tried."""

STILL_M, STILL_STEPS, STOP_M = 0.002, 10, 0.13
"""A drawer that the hand has moved so near to an end, and that then moves by less in so many steps,
is at its stop."""


class SeenFurniture(SeenKnown):
    """A scene with a door or drawer that is found in the images, before its skill starts.

    The hand can only hold its handle here.
    """

    @property
    def holding(self) -> bool:
        """Whether the hand holds an object: never."""
        return False

    @abstractmethod
    def find(self, opened: bool) -> bool:
        """Looks for the furniture around the object; returns whether it is found, now or before.

        Args:
            opened: Whether it is, or may be, open.
        """

    @abstractmethod
    def _articulations(self) -> tuple[ArticulationState, ...]:
        """Returns the door or drawer, once it was found."""

    def _modeled(self, points_m: Array, margin_m: float) -> NDArray[np.bool_]:
        """Whether world points (K, 3) are the furniture's."""
        near = super()._modeled(points_m, margin_m)
        for body, frame in self._bodies() if len(points_m) else ():
            body_from_world = invert_pose(frame)
            local_m = points_m @ body_from_world[:3, :3].T + body_from_world[:3, 3]
            for shape in body.shapes:
                middle_m, half_m = shape.body_from_shape[:3, 3], shape.half_size_m
                gaps_m = box_distance_m(local_m, middle_m - half_m, middle_m + half_m)
                near |= gaps_m < max(SEEN_M, margin_m)
        return near


class SeenFridge(SeenFurniture):
    """A scene with a fridge that is found by its known shape.

    How far its door is open is felt and seen.
    """

    def forget(self) -> None:
        """Starts a new episode."""
        super().forget()
        self._found: Found | None = None
        self._taken: tuple[float, float] | None = None
        self._age, self._widest_rad = 0, 0.0
        self._felt_rad, self._opened, self._pushed = 0.0, False, False
        self._looks: list[Images] = []

    def see(self, obs: Mapping[str, Any], row: int) -> None:
        """Processes an observation; a held handle tells how far the door is open."""
        super().see(obs, row)
        self._age += 1
        if self._found is None or not self._was_holding:
            self._taken = None
            return
        self._looks.clear()  # the door moves
        self._pushed = False
        x, y, _, joint = hinges_of(self._found.pose[None], self._found.side)[0]
        at_rad = np.arctan2(*(self._world_from_ee()[:2, 3] - (x, y))[::-1])
        if self._taken is None:
            self._taken = joint, at_rad
        began_rad, first_rad = self._taken
        turned_rad = np.angle(np.exp(1j * (at_rad - first_rad)))
        self._felt_rad = float(began_rad - self._found.side * turned_rad)
        self._open_by(self._felt_rad)

    def find(self, opened: bool) -> bool:
        """Looks for the fridge around the object; returns whether it is found, now or before."""
        self.look()
        images, base_m = self._views(), self.world_from_base[:2, 3]
        # One that is to be opened may stand ajar after an attempt.
        tried = [find_fridge(images, self.object_m(0), base_m, one) for one in {opened, True}]
        likely = [one for one in tried if one and one.pose[3] <= self._most_rad]
        found = max(likely, key=lambda one: one.score, default=None)
        if found is not None and (self._found is None or found.score > self._found.score):
            self._found, self._opened = found, opened
            self._felt_rad = float(found.pose[3])
            self._open_by(self._felt_rad)
            self._suppose_walls()
        return self._found is not None

    def missed(self) -> None:
        """Looks for the fridge again, as its handle is not where it is believed."""
        before = self._fridge
        self.find(self._opened)
        if self._fridge is before:
            joint = seen_joint(self._views(), before, MOST_RAD, self._most_rad)
            self._open_by(before.pose[3] if joint is None else joint)

    def met(self, path: Array) -> None:
        """Records contact of the arm, perhaps with the door; see `SeenScene.met`."""
        super().met(path)
        self._pushed = True

    def articulation(self, number: int) -> ArticulationState:
        """Returns the fridge's door."""
        if not self._was_holding and self._age >= REFIT_STEPS:
            self._age = 0
            self._watch_door()
        return articulation_of(self._fridge.pose, self._fridge.side, self._was_holding)

    def floor_map(self, joints: Mapping[int, float] | None = None) -> NavigationMap:
        """Returns the map of the floor between what was seen; unseen floor is free."""
        centres_m = self._surfaces_m()
        if self.risk_level < 2:
            centres_m = np.concatenate((centres_m, self.map.felt_m()))
        high = (centres_m[:, 2] > LOWEST_M) & (centres_m[:, 2] < HIGHEST_M)
        centres_m = centres_m[high & ~self._modeled(centres_m, SEEN_M)]
        cells = np.floor(centres_m[:, :2] / CELL_M)
        cells, counts = np.unique(cells, axis=0, return_counts=True)
        cells = cells[counts >= LEAST_VOXELS] * CELL_M
        squares = cells[:, None] + CELL_M * np.array(((0, 0), (1, 0), (1, 1), (0, 1)))
        joint = (joints or {}).get(0, float(self._fridge.pose[3]))
        pose = np.append(self._fridge.pose[:3], joint)
        fridge = [
            outline for body, frame in self._bodies_at(pose) for outline in _footprints(body, frame)
        ]
        here_m = self.world_from_base[:2, 3]
        corners = here_m + AROUND_M * np.array(((-1.0, -1.0), (1.0, 1.0)))
        floor = floor_between([*squares, *fridge], corners)
        return NavigationMap(floor, np.zeros_like(floor.room))

    def _suppose_walls(self) -> None:
        """Adds to the map what is probably beside the robot, where no camera has looked."""
        centres_m = self._surfaces_m()
        centres_m = centres_m[~self._modeled(centres_m, SEEN_M)]
        spacing_m = self.config.map.voxels.size_m
        self.map.add_contacts(supposed_walls(centres_m, self._fridge.pose, spacing_m))

    def _surfaces_m(self) -> Array:
        """Returns the map's surfaces (V, 3) around the robot."""
        return self.map.occupied_m(self._shoulder_m, self.config.reach_m + AROUND_M)

    @property
    def _fridge(self) -> Found:
        assert self._found is not None, "the fridge was not found"
        return self._found

    def _views(self) -> Images:
        """Returns the current images, and earlier ones from elsewhere since the door was moved."""
        now = self._images()
        seen = Images.joined([*self._looks, now])
        moved = [np.abs(one.cameras[0] - now.cameras[0]).max() for one in self._looks[-1:]]
        if min(moved, default=np.inf) > ELSEWHERE:
            self._looks = [*self._looks, now][-MOST_LOOKS:]
            if self._found is not None:
                self._found = refined(seen, self._found, self.object_m(0), self._opened)
        return seen

    def _watch_door(self) -> None:
        """Sees how far the door is open, once the hand has let it go."""
        views = self._views()
        from_rest_m = self._arm.ee_pose(self.arm_qpos)[:3, 3] - self.robot.rest_position_m
        rests = not self._opened and np.linalg.norm(from_rest_m) < REST_RADIUS_M
        # An arm at rest hides nothing of a door that it may have pushed since the older views.
        seen = self._images() if rests else views
        joint = seen_joint(seen, self._fridge, *((MOST_RAD, self._most_rad) if rests else ()))
        if joint is None or not (self._opened or self._widest_rad > 0.0):
            return
        if not (self._opened or rests):
            # A door that was opened stays, and its inside may be taken for its front.
            around = PUSHED_RAD if self._pushed else AS_FELT_RAD
            joint = float(np.clip(joint, *(self._felt_rad + around)))
        self._open_by(joint)

    @property
    def _most_rad(self) -> float:
        """How far the door may be open: one that the hand opens swings on by little."""
        opens = self._found is not None and not self._opened
        return min(MOST_RAD, self._widest_rad + AS_FELT_RAD[1]) if opens else MOST_RAD

    def _open_by(self, joint: float) -> None:
        """Sets how far the door is believed to be open [rad]."""
        self._found = replace(self._fridge, pose=np.append(self._fridge.pose[:3], max(joint, 0.0)))
        self._widest_rad = max(self._widest_rad, joint)

    def _bodies(self) -> list[tuple[CollisionBody, Array]]:
        """Returns the fridge and its upper door; nothing before it was found."""
        return [] if self._found is None else self._bodies_at(self._found.pose)

    def _bodies_at(self, pose: Array) -> list[tuple[CollisionBody, Array]]:
        frames = poses_of(pose, self._fridge.side)
        return [(body, frames[body.name]) for body in bodies(self._fridge.side)]

    def _articulations(self) -> tuple[ArticulationState, ...]:
        """Returns the fridge's door, once it was found."""
        if self._found is None:
            return ()
        return (articulation_of(self._found.pose, self._found.side, self._was_holding),)

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

    def _modeled(self, points_m: Array, margin_m: float) -> NDArray[np.bool_]:
        """Whether world points (K, 3) are the fridge's."""
        near = super()._modeled(points_m, margin_m)
        return near if self._found is None else near | self._swept(points_m)


class SeenDrawer(SeenFurniture):
    """A scene with a drawer whose front is seen, and whose opening is felt.

    Where its handle is along the front may be tried: the hand takes one that is near.
    """

    def forget(self) -> None:
        """Starts a new episode."""
        super().forget()
        self._found: FoundDrawer | None = None
        self._missed, self._still = 0, 0
        self._least_m, self._most_m = 0.0, 0.0
        self._taken_m: Array | None = None
        self._hand_m = np.zeros(3)

    def see(self, obs: Mapping[str, Any], row: int) -> None:
        """Processes an observation; a held handle tells how far the drawer is open."""
        super().see(obs, row)
        hand_m = self._world_from_ee()[:3, 3]
        moved_m, self._hand_m = float(np.linalg.norm(hand_m - self._hand_m)), hand_m
        if self._found is None or not self._was_holding:
            self._taken_m, self._still = None, 0
            return
        if self._taken_m is None:
            self._taken_m = hand_m
        found = self._found
        along_m = float((hand_m - found.closed_m) @ found.aside) * found.aside
        joint = float((hand_m - found.closed_m) @ found.axis)
        self._found = found = replace(found, closed_m=found.closed_m + along_m, joint=joint)
        self._most_m = max(self._most_m, joint)
        self._still = self._still + 1 if moved_m < STILL_M else 0
        end_m = TRAVEL_M if (hand_m - self._taken_m) @ found.axis > 0.0 else 0.0
        if self._still >= STILL_STEPS and abs(joint - end_m) < STOP_M:
            closed_m = found.closed_m + (joint - end_m) * found.axis
            self._found = replace(found, closed_m=closed_m, joint=end_m)

    def find(self, opened: bool) -> bool:
        """Looks for the drawer around the object; returns whether it is found, now or before."""
        self.look()
        base_m = self.world_from_base[:2, 3]
        found = find_drawer(self._images().points_m, self.object_m(0), base_m, opened)
        if found is not None:
            self._found, self._missed, self._most_m = found, 0, found.joint
        return self._found is not None

    def missed(self) -> None:
        """Takes note that the hand has closed where the handle is believed, and holds nothing."""
        found = self._drawer
        handle_m = found.closed_m + found.joint * found.axis
        if np.linalg.norm(self._hand_m - handle_m) > REACHED_M:
            return
        before, self._missed = BESIDE_M[self._missed], (self._missed + 1) % len(BESIDE_M)
        closed_m = found.closed_m + (BESIDE_M[self._missed] - before) * found.aside
        self._found = replace(found, closed_m=closed_m)

    def articulation(self, number: int) -> ArticulationState:
        """Returns the drawer."""
        found = self._drawer
        handle_m = found.closed_m + found.joint * found.axis
        return ArticulationState(
            kind="drawer",
            body=DRAWER.name,
            handle_m=handle_m,
            held=self._was_holding,
            joint=found.joint,
            limits=(0.0, TRAVEL_M),
            slides=True,
            axis=found.axis,
            axis_point_m=handle_m,
            frame=np.array((*handle_m[:2], found.yaw_rad)),
        )

    @property
    def _drawer(self) -> FoundDrawer:
        assert self._found is not None, "the drawer was not found"
        return self._found

    def _frame(self) -> Array:
        """Returns the drawer's pose (4, 4): its handle, out, along its front and up."""
        found, frame = self._drawer, np.eye(4)
        frame[:3, 0], frame[:3, 1] = found.axis, found.aside
        frame[:3, 3] = found.closed_m + found.joint * found.axis
        return frame

    def _bodies(self) -> list[tuple[CollisionBody, Array]]:
        """Returns the drawer; nothing before it was found."""
        return [] if self._found is None else [(DRAWER, self._frame())]

    def _articulations(self) -> tuple[ArticulationState, ...]:
        """Returns the drawer, once it was found."""
        return () if self._found is None else (self.articulation(0),)

    def _modeled(self, points_m: Array, margin_m: float) -> NDArray[np.bool_]:
        """Whether world points (K, 3) are the drawer's, or where it has moved."""
        near = super()._modeled(points_m, margin_m)
        if self._found is None:
            return near
        gaps_m = points_m - self._found.closed_m
        out_m = gaps_m @ self._found.axis
        inside = np.abs(gaps_m @ self._found.aside) < HALF_WIDTH_M + SEEN_M
        inside &= np.abs(gaps_m[:, 2]) < DRAWER_HALF_M + SEEN_M
        return near | (inside & (out_m > -0.6) & (out_m < self._most_m + HANDLE_M))


def _footprints(body: CollisionBody, frame: Array) -> list[Array]:
    """Returns the outlines (4, 2) of a body's boxes on the floor."""
    corners = np.array(((-1, -1), (1, -1), (1, 1), (-1, 1)))
    return [
        (shape.body_from_shape[:2, 3] + corners * shape.half_size_m[:2]) @ frame[:2, :2].T
        + frame[:2, 3]
        for shape in body.shapes
    ]
