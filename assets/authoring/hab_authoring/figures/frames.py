"""Figure of the frames of observations and actions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import sapien
from mani_skill.utils.sapien_utils import look_at
from matplotlib.axes import Axes
from numpy.typing import NDArray
from PIL import Image

from hab_authoring.showroom import photograph
from hab_tasks.figure_style import BLUE, GREEN, ORANGE, VERMILION, new_figure, save
from hab_tasks.geometry import Array

AXES = (("x", VERMILION), ("y", GREEN), ("z", BLUE))
SIZE_PX, INCHES = (660, 540), 4.4
FIELD_RAD = 0.62
COLORS = 128
HALO = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.8}


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """A frame to draw.

    Attributes:
        name: Its label.
        world_from_frame: (4, 4) its pose.
        length_m: Drawn length of its axes.
    """

    name: str
    world_from_frame: Array
    length_m: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Arrow:
    """A vector to draw, dashed.

    Attributes:
        name: Its label.
        start_m: (3,) in the world.
        end_m: (3,) in the world.
    """

    name: str
    start_m: Array
    end_m: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Photo:
    """An image with its camera parameters.

    Attributes:
        image: (H, W, 3) uint8.
        eye_from_world: (3, 4), x right, y down, z ahead.
        intrinsics: (3, 3).
    """

    image: NDArray[np.uint8]
    eye_from_world: Array
    intrinsics: Array

    def pixel(self, point_m: Array) -> Array:
        """Projects a world point (3,) to the image, (2,): column and row."""
        x, y, ahead = self.intrinsics @ (self.eye_from_world @ np.append(point_m, 1.0))
        return np.array((x / ahead, y / ahead))


def photo_of(scene: sapien.Scene, eye_m: Array, at_m: Array) -> Photo:
    """Renders a scene from a point (3,) towards another (3,)."""
    camera = sapien.render.RenderCameraComponent(*SIZE_PX)
    camera.set_fovy(FIELD_RAD)
    camera.near, camera.far = 0.05, 50.0
    image, eye_from_world = photograph(scene, camera, look_at(eye_m.tolist(), at_m.tolist()).sp)
    intrinsics = np.array(camera.get_intrinsic_matrix(), dtype=float)
    return Photo(image=image, eye_from_world=eye_from_world, intrinsics=intrinsics)


def draw_frames(file: Path, photo: Photo, frames: Sequence[Frame], arrows: Sequence[Arrow]) -> None:
    """Writes an image overlaid with frames and arrows."""
    height, width = photo.image.shape[:2]
    figure = new_figure(INCHES, INCHES * height / width)
    figure.set_layout_engine("none")
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    # With few colours the file is much smaller.
    few = Image.fromarray(photo.image).quantize(COLORS, dither=Image.Dither.NONE)
    axes.imshow(np.asarray(few.convert("RGB")))
    axes.set_axis_off()
    for arrow in arrows:
        start, end = photo.pixel(arrow.start_m), photo.pixel(arrow.end_m)
        _arrow(axes, start, end, ORANGE, "--")
        _label(axes, end, arrow.name, (0, -16))
    for frame in frames:
        origin_m = frame.world_from_frame[:3, 3]
        origin = photo.pixel(origin_m)
        for number, (name, color) in enumerate(AXES):
            tip = photo.pixel(origin_m + frame.length_m * frame.world_from_frame[:3, number])
            _arrow(axes, origin, tip, color, "-")
            _label(axes, tip + 0.15 * (tip - origin), name, (0, 0))
        _label(axes, origin, frame.name, (58, 14))
    axes.set_xlim(0, width)
    axes.set_ylim(height, 0)
    save(figure, file)


def _arrow(axes: Axes, start: Array, end: Array, color: str, line: str) -> None:
    look = {"arrowstyle": "-|>", "color": color, "linewidth": 2.0, "linestyle": line}
    axes.annotate("", (*end,), xytext=(*start,), arrowprops=look | {"shrinkA": 0, "shrinkB": 0})


def _label(axes: Axes, at: Array, words: str, aside_pt: tuple[int, int]) -> None:
    placement = {"xytext": aside_pt, "textcoords": "offset points", "ha": "center", "va": "center"}
    axes.annotate(words, (*at,), fontsize=9, bbox=HALO, **placement)
