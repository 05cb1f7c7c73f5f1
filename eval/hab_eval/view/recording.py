"""Recordings of motions: a viser scene that a page plays back without a server."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
import viser

from hab_eval.run.motion import Motion
from hab_eval.view.panels import Panels
from hab_tasks.arrays import Floats
from hab_tasks.constants import CONTROL_HZ
from hab_tasks.engine.ray_sensors import ROBOT
from hab_tasks.engine.viewpoint import arrow_mesh
from hab_tasks.geometry import planar
from hab_tasks.world.raycast.library import mesh_of
from hab_tasks.world.scenes.visuals import Visual

Suffix = Literal[".html", ".viser"]

MOVED = 1e-4
"""A pose changes by more than this [m, or in a quaternion's entry] to be recorded."""

CONTACT_COLOR, CONTACT_SIZE_M = (230, 0, 160), 0.04
BOX_COLOR = (200, 195, 188)


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
    scene = _Scene(server, motion, trace)
    serializer = server.get_scene_serializer()
    for step in range(1, len(motion.poses)):
        serializer.insert_sleep(1.0 / CONTROL_HZ)
        scene.show(step)
    serializer.insert_sleep(1.0)  # the outcome
    return serializer.serialize() if suffix == ".viser" else serializer.as_html().encode()


class _Scene:
    """The scene of a motion at one of its steps."""

    def __init__(
        self, server: viser.ViserServer, motion: Motion, trace: Sequence[Mapping[str, Any]]
    ) -> None:
        """Shows the first step."""
        self._server, self._motion = server, motion
        server.scene.set_up_direction("+z")
        server.scene.configure_default_lights(cast_shadow=False)
        self._robot = server.scene.add_frame(f"/{ROBOT}", show_axes=False)
        self._nodes: list[Any] = [self._add_body(*body) for body in motion.bodies]
        self._in_robot = np.array([name.startswith(f"{ROBOT}/") for name, _ in motion.bodies])
        self._marks = [self._add_mark(n, color) for n, color in enumerate(motion.marks)]
        self._panels = Panels(server, motion, trace)
        self._base = np.full(7, np.inf)
        self._poses = np.full((len(motion.bodies), 7), np.inf)
        self._touching = False
        self.show(0)

    def show(self, step: int) -> None:
        """Moves everything to a step."""
        motion = self._motion
        base = np.array(planar(*map(float, motion.bases[step])))
        if np.abs(base - self._base).max() > MOVED:
            self._base = base
            _move(self._robot, base)
        poses = motion.poses[step].copy()
        # Links move with the robot, so that only what moves in it is recorded.
        poses[self._in_robot] = _seen_from(self._base, poses[self._in_robot])
        moved = np.abs(poses - self._poses).max(axis=1) > MOVED
        for row in np.flatnonzero(moved):
            self._poses[row] = poses[row]
            _move(self._nodes[row], poses[row])
        for node, tip_m in zip(self._marks, motion.marks_m[step], strict=True):
            node.position = tip_m
        self._show_contacts(motion.contacts_m[step])
        self._panels.show(step)

    def _show_contacts(self, points_m: Floats) -> None:
        if len(points_m):
            self._server.scene.add_point_cloud(
                "/contacts",
                points_m,
                CONTACT_COLOR,
                point_size=CONTACT_SIZE_M,
                point_shape="circle",
                precision="float32",
            )
        elif self._touching:
            self._server.scene.remove_by_name("/contacts")
        self._touching = len(points_m) > 0

    def _add_body(self, name: str, visuals: Sequence[Visual]) -> Any:
        """Adds the shapes of a body under a frame, and returns the frame."""
        path = f"/{name}" if name.startswith(f"{ROBOT}/") else f"/scene/{name}"
        frame = self._server.scene.add_frame(path, show_axes=False)
        for number, visual in enumerate(visuals):
            self._add_visual(f"{path}/{number}", visual)
        return frame

    def _add_visual(self, path: str, visual: Visual) -> None:
        at = visual.body_from_visual
        if visual.file is not None and visual.file.suffix == ".glb":
            # The file itself; equal files are stored once.
            self._server.scene.add_glb(
                path,
                visual.file.read_bytes(),
                scale=tuple(visual.size),  # pyright: ignore[reportArgumentType]  # of three numbers
                position=at[:3],
                wxyz=at[3:],
                cast_shadow=False,
                receive_shadow=False,
            )
            return
        shape = mesh_of((visual,))
        self._server.scene.add_mesh_simple(path, shape.vertices_m, shape.faces, color=BOX_COLOR)

    def _add_mark(self, number: int, color: Sequence[float]) -> Any:
        arrow = arrow_mesh()
        return self._server.scene.add_mesh_simple(
            f"/marks/{number}",
            np.asarray(arrow.vertices),
            np.asarray(arrow.faces),
            color=np.asarray(color),
            cast_shadow=False,
            receive_shadow=False,
        )


def _move(node: Any, pose: Floats) -> None:
    node.position, node.wxyz = pose[:3], pose[3:]


def _seen_from(base: Floats, poses: Floats) -> Floats:
    """Returns poses (L, 7) in the frame of a base (7,) that is only turned about z."""
    (w, _, _, z), q = base[3:], poses[:, 3:].T
    cosine, sine = w * w - z * z, 2.0 * w * z
    x, y, height = (poses[:, :3] - base[:3]).T
    turned = (
        *(w * q[0] + z * q[3], w * q[1] + z * q[2]),
        *(w * q[2] - z * q[1], w * q[3] - z * q[0]),
    )
    return np.stack((cosine * x + sine * y, cosine * y - sine * x, height, *turned), axis=1)
