"""Poses of furniture in wild layouts: at walls, in corners, or free with narrow aisles."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hab_authoring.layouts.furnishing import Piece
from hab_authoring.layouts.overlaps import extent, pieces_of
from hab_authoring.layouts.standing import FloorPlan, lookup
from hab_tasks.constants import BASE_RADIUS_M
from hab_tasks.privileged import Array
from hab_tasks.world.scenes.floor import CELL_M, FreeFloor
from hab_tasks.world.scenes.layout_geometry import STAGE, Layout

AISLE_M = 2 * BASE_RADIUS_M + 0.05
"""Target width of aisles; the floor map has cells of 5 cm."""

WALL_FROM_M, WALL_TO_M, TALL_M = 0.3, 0.7, 1.8
"""Walls extend from below the first to above the second height; a kitchen requires the third."""

DOOR_M = (0.87, 1.97)
"""Height range of the fridge's upper door."""

TIP_M = (0.62, 0.107)
"""Outer edge of that door's handle: distance from the hinge along the door, and from its plane."""

SWING_M = 0.35
"""A wall that extends this far beyond the fridge's front blocks its door."""


@dataclass(frozen=True, kw_only=True)
class PiecePose:
    """Planar pose of a piece: centre (2,) of its outline, and unit vector (2,) to its back."""

    center_m: Array
    back: Array


@dataclass(frozen=True, kw_only=True)
class Face:
    """A side of a wall.

    Attributes:
        axis: The axis (0 or 1) that it is normal to.
        sign: Whether its outside looks along that axis (1) or against it (-1).
        at_m: Its coordinate on that axis.
        span_m: Its extent on the other axis.
    """

    axis: int
    sign: int
    at_m: float
    span_m: tuple[float, float]

    @property
    def left(self) -> int:
        """Direction along the face to the left of a piece with its back to it: 1 up, -1 down."""
        return -self.sign if self.axis == 0 else self.sign

    def pose_at(self, piece: Piece, along_m: float, gap_m: float) -> PiecePose:
        """Returns the pose of a piece with its back to the face."""
        center = np.zeros(2)
        center[self.axis] = self.at_m + self.sign * (gap_m + piece.half_m[0])
        center[1 - self.axis] = along_m
        back = np.zeros(2)
        back[self.axis] = -self.sign
        return PiecePose(center_m=center, back=back)


class PoseSampler:
    """Samples poses of pieces in one stage mesh."""

    def __init__(self, layout: Layout, plan: FloorPlan) -> None:
        """Extracts the faces of the walls and the room between them."""
        walls = [extent(b).box_m for b in pieces_of(layout, [STAGE]).all]
        walls = [b for b in walls if b[0, 2] < WALL_FROM_M and b[1, 2] > WALL_TO_M]
        self._faces = [face for box in walls for face in _faces(box)]
        self._tall = [f for box in walls if box[1, 2] > TALL_M for f in _faces(box)]
        self._bare = plan.bare
        labelled: Any = ndimage.label(self._bare.clearance_m > 0)
        room = np.isin(labelled[0], np.unique(labelled[0][self._bare.room]))
        # A cell that is partly wall may contain furniture in its other part.
        inside: Any = ndimage.binary_dilation(room, np.ones((3, 3)))
        self._inside: NDArray[np.bool_] = inside
        self._cells = np.argwhere(self._bare.room)

    def holds(self, piece: Piece, pose: PiecePose) -> bool:
        """Whether a piece at a pose is in the robot's room and not in a wall."""
        across = np.array((-pose.back[1], pose.back[0]))
        grid = np.linspace(-0.9, 0.9, 7)
        u, v = (g.reshape(-1, 1) for g in np.meshgrid(grid, grid))
        points = pose.center_m + u * piece.half_m[0] * pose.back + v * piece.half_m[1] * across
        return bool(lookup(self._inside, self._bare, points).all())

    def at_walls(
        self, piece: Piece, rng: np.random.Generator, tall: bool = False
    ) -> Iterator[PiecePose]:
        """Yields poses with the back to a wall, endlessly; some are flush with the next wall."""
        faces = self._tall if tall else self._faces
        lengths = np.array([f.span_m[1] - f.span_m[0] for f in faces])
        while True:
            face = faces[int(rng.choice(len(faces), p=lengths / lengths.sum()))]
            low, high = face.span_m
            along = rng.uniform(low - 0.2, high + 0.2)
            if rng.random() < 0.3:
                along = rng.choice((low + piece.half_m[1] + 0.02, high - piece.half_m[1] - 0.02))
            yield face.pose_at(piece, float(along), float(rng.uniform(0.012, 0.03)))

    def free(self, piece: Piece, rng: np.random.Generator) -> Iterator[PiecePose]:
        """Yields poses anywhere in the room, endlessly."""
        while True:
            cell = self._cells[int(rng.integers(len(self._cells)))]
            turn = 0.5 * math.pi * rng.integers(4) + rng.uniform(-0.35, 0.35)
            yield PiecePose(
                center_m=self._bare.origin_m + CELL_M * cell + rng.uniform(-0.025, 0.025, 2),
                back=np.array((math.cos(turn), math.sin(turn))),
            )

    def in_corners(
        self,
        piece: Piece,
        hinge_m: float,
        layout: Layout,
        rng: np.random.Generator,
        angles_rad: tuple[float, float],
        hinge_side: bool,
    ) -> Iterator[PiecePose]:
        """Yields poses of a fridge beside tall bodies, endlessly; none without tall bodies.

        Args:
            piece: The fridge.
            hinge_m: Offset of its hinges from its centre, to the left as seen from its back.
            layout: The pieces placed so far.
            rng: Random generator.
            angles_rad: Range of angles at which the door is blocked.
            hinge_side: Whether the tall body is on the hinges' side, or on the other one.
        """
        boxes = [extent(b).box_m for b in layout.placed.values() if b.piece != piece.name]
        boxes = [b for b in boxes if b[0, 2] < DOOR_M[1] and b[1, 2] > DOOR_M[0]]
        corners = [
            (face, box, sign)
            for face in self._tall
            for box in boxes
            for sign in (-1, 1)
            if _is_corner(face, box, piece, sign)
            and (np.sign(hinge_m) * face.left == sign) == hinge_side
        ]
        while corners:
            face, box, sign = corners[int(rng.integers(len(corners)))]
            edge = box[0 if sign > 0 else 1, 1 - face.axis]
            over = rng.uniform(*angles_rad) - math.pi / 2
            gap = TIP_M[0] * math.sin(over) + TIP_M[1] * math.cos(over)
            beside = abs(hinge_m) + gap if hinge_side else piece.half_m[1] + rng.uniform(0.01, 0.3)
            yield face.pose_at(piece, float(edge - sign * beside), float(rng.uniform(0.012, 0.03)))


def crowding(piece: Piece, pose: PiecePose, floor: FreeFloor) -> float:
    """Returns the deviation of the aisle at a pose from `AISLE_M`.

    Args:
        piece: The piece.
        pose: Its pose.
        floor: The free floor without it.
    """
    across = np.array((-pose.back[1], pose.back[0]))
    depth, width = piece.half_m
    edge = np.linspace(-1.0, 1.0, 9)[:, None]
    sides = [
        -depth * pose.back + edge * width * across,
        width * across + edge * depth * pose.back,
        -width * across + edge * depth * pose.back,
    ]
    gaps = []
    for side in sides:
        index = np.round((pose.center_m + side - floor.origin_m) / CELL_M).astype(int)
        index = np.clip(index, 0, np.array(floor.clearance_m.shape) - 1)
        gaps.append(float(floor.clearance_m[index[:, 0], index[:, 1]].min()))
    return min(abs(gap - AISLE_M) for gap in gaps)


def _faces(box_m: Array) -> Iterator[Face]:
    for axis in (0, 1):
        span = (float(box_m[0, 1 - axis]), float(box_m[1, 1 - axis]))
        for sign, end in ((-1, 0), (1, 1)):
            yield Face(axis=axis, sign=sign, at_m=float(box_m[end, axis]), span_m=span)


def _is_corner(face: Face, box_m: Array, piece: Piece, sign: int) -> bool:
    """Whether a fridge with its back to a face can have a box beside it, up (1) or down (-1)."""
    front = face.at_m + face.sign * 2 * piece.half_m[0]
    near, far = sorted((front, front + face.sign * SWING_M))
    if box_m[0, face.axis] > near + 0.1 or box_m[1, face.axis] < far - 0.1:
        return False
    edge = box_m[0 if sign > 0 else 1, 1 - face.axis]
    low, high = face.span_m
    room = 2 * piece.half_m[1]
    return low + room < edge < high + room if sign > 0 else low - room < edge < high - room
