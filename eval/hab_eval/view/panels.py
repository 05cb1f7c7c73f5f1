"""Camera images, captions and beliefs above the scene of a recording, and its first view."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import viser
import viser.transforms as tf

from hab_eval.run.motion import Motion
from hab_tasks.arrays import Floats
from hab_tasks.captions import Frame

LEAST_RADIUS_M = 1.8
"""Least radius of what the first view shows."""

ABOVE_M = 2.75
"""Height of the panels: above the walls."""

UPWARDS = 0.5
"""Slope of the panels' direction from the first view."""

TEXT_WIDTH = 60
BELIEFS = 12
"""Most lines of beliefs."""


class Panels:
    """What a recording says of a step."""

    def __init__(
        self, server: viser.ViserServer, motion: Motion, trace: Sequence[Mapping[str, Any]]
    ) -> None:
        """Places the panels on the far side of the robot's path, and the camera opposite."""
        self._server, self._motion = server, motion
        self._beliefs, self._belief = beliefs_of(trace), ""
        center_m, radius_m = _circle(motion)
        eye_m = center_m + radius_m * np.array((-0.8, -0.8, 1.8))
        server.initial_camera.position, server.initial_camera.look_at = eye_m, center_m
        right, down, ahead = _axes(eye_m, center_m)
        # Just before a ray to the upper edge of the view comes down to the top of the walls.
        ray = ahead - UPWARDS * down
        distance_m = 0.85 * (ABOVE_M - eye_m[2]) / ray[2]
        self._origin_m, self._size_m = eye_m + distance_m * ray, 0.26 * distance_m
        self._right = right
        self._wxyz = tf.SO3.from_matrix(np.stack((right, down, ahead), axis=1)).wxyz
        self._images: dict[str, Any] = {}
        beside_m = self._origin_m + self._size_m * (1.2 * right - 0.5 * down)
        self._text = server.scene.add_label("/panels/text", "", position=beside_m)

    def show(self, step: int) -> None:
        """Shows a step; images stay until the next ones."""
        self._belief = self._beliefs.get(step, self._belief)
        words = textwrap.wrap(self._motion.instruction, TEXT_WIDTH)
        text = "\n".join((*words, self._motion.captions[step], self._belief)).rstrip()
        if text != self._text.text:
            self._text.text = text
        for number, (name, image) in enumerate(self._motion.images.get(step, {}).items()):
            if name in self._images:
                self._images[name].image = image
            else:
                self._images[name] = self._add_image(name, image, number)

    def _add_image(self, name: str, image: Frame, number: int) -> Any:
        at = self._origin_m + (number - 0.5) * 1.1 * self._size_m * self._right
        height, width = image.shape[:2]
        self._server.scene.add_label(
            f"/panels/{name}/name", name, position=(0.0, -0.5 * self._size_m, 0.0)
        )
        return self._server.scene.add_image(
            f"/panels/{name}",
            image,
            self._size_m * width / height,
            self._size_m,
            position=at,
            wxyz=self._wxyz,
            cast_shadow=False,
            receive_shadow=False,
        )


def beliefs_of(trace: Sequence[Mapping[str, Any]]) -> dict[int, str]:
    """Returns step -> what the robot believed from then on, and what it did."""
    found = {}
    for entry in trace:
        if "step" in entry and "believed" in entry:
            atoms = entry["believed"]
            more = [f"and {len(atoms) - BELIEFS} more"] if len(atoms) > BELIEFS else []
            lines = [f"{entry.get('action', '')}: {entry.get('did', '')}"]
            lines += ["believes:"] if atoms else []
            found[int(entry["step"])] = "\n".join((*lines, *atoms[:BELIEFS], *more))
    return found


def _circle(motion: Motion) -> tuple[Floats, float]:
    """Returns centre (3,) and radius [m] of a circle around the robot's path and the marks."""
    points = np.concatenate([np.array(motion.bases)[:, :2], *(m[:, :2] for m in motion.marks_m)])
    low, high = points.min(axis=0), points.max(axis=0)
    center = (low + high) / 2
    radius = max(LEAST_RADIUS_M, 0.45 * float(np.linalg.norm(high - low)))
    return np.array((*center, 0.6)), radius


def _axes(eye_m: Floats, target_m: Floats) -> tuple[Floats, Floats, Floats]:
    """Returns right, down and ahead of a camera, each (3,)."""
    ahead = (target_m - eye_m) / np.linalg.norm(target_m - eye_m)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right = right / np.linalg.norm(right)
    return right, np.cross(ahead, right), ahead
