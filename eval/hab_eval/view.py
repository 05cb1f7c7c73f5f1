"""Recordings of motions: a viser scene that a page plays back without a server.

Camera images, captions and beliefs are above the scene.
"""

from __future__ import annotations

import contextlib
import io
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

from hab_eval.run.motion import Motion
from hab_tasks.arrays import Floats
from hab_tasks.captions import Frame
from hab_tasks.constants import CONTROL_HZ
from hab_tasks.geometry import from_matrix
from hab_tasks.web_scene import WebScene, viser

Suffix = Literal[".html", ".viser"]

LEAST_RADIUS_M = 1.8
"""Least radius of what the first view shows."""

ABOVE_M = 2.75
"""Height of the panels: above the walls."""

UPWARDS = 0.5
"""Slope of the panels' direction from the first view."""

TEXT_WIDTH = 60
BELIEFS = 12
"""Most lines of beliefs."""


def record(motion: Motion, trace: Sequence[Mapping[str, Any]], suffix: Suffix) -> bytes:
    """Returns a page, or a file for viser's client, with the episode at real-time speed.

    Args:
        motion: The episode.
        trace: The agent's trace; of entries with a ``step``, what it ``believed`` is shown.
        suffix: ``.html`` or ``.viser``.
    """
    # viser prints where its server is; nobody connects to it.
    with contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host="127.0.0.1", verbose=False)
        try:
            return _recorded(server, motion, trace, suffix)
        finally:
            server.stop()


def _recorded(
    server: viser.ViserServer, motion: Motion, trace: Sequence[Mapping[str, Any]], suffix: Suffix
) -> bytes:
    """Plays the motion in a server's scene, and returns the recording."""
    scene = WebScene(server, motion.bodies, motion.marks)
    panels = Panels(server, motion, trace)
    _show(scene, panels, motion, 0)
    serializer = server.get_scene_serializer()
    for step in range(1, len(motion.poses)):
        serializer.insert_sleep(1.0 / CONTROL_HZ)
        _show(scene, panels, motion, step)
    serializer.insert_sleep(1.0)  # the outcome
    return serializer.serialize() if suffix == ".viser" else serializer.as_html().encode()


def _show(scene: WebScene, panels: Panels, motion: Motion, step: int) -> None:
    base, poses = motion.bases[step], motion.poses[step]
    scene.show(base, poses, motion.marks_m[step], motion.contacts_m[step])
    panels.show(step)


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
        turned = np.eye(4)
        turned[:3, :3] = np.stack((right, down, ahead), axis=1)
        self._wxyz = from_matrix(turned)[3:]
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
