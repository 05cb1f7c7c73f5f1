"""An episode's scene in the browser, by viser: robot, furniture, objects, marks and contacts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hab_tasks.arrays import Floats
from hab_tasks.engine.ray_sensors import ROBOT
from hab_tasks.engine.viewpoint import arrow_mesh
from hab_tasks.errors import HabError
from hab_tasks.geometry import planar
from hab_tasks.world.raycast.library import mesh_of
from hab_tasks.world.scenes.visuals import Visual, Visuals

try:
    import viser
except ImportError as error:
    raise HabError("viser is not installed; run: pip install 'hab-tasks[view]'") from error

MOVED = 1e-4
"""A pose changes by more than this [m, or in a quaternion's entry] to be sent."""

CONTACT_COLOR, CONTACT_SIZE_M = (230, 0, 160), 0.04
BOX_COLOR = (200, 195, 188)


class WebScene:
    """Bodies, marks and contacts in the scene of a viser server."""

    def __init__(
        self,
        server: viser.ViserServer,
        bodies: Sequence[tuple[str, Visuals]],
        marks: Sequence[tuple[float, float, float]],
    ) -> None:
        """Adds the bodies, by name and shapes, and an arrow of each mark's color."""
        self._server = server
        server.scene.set_up_direction("+z")
        server.scene.configure_default_lights(cast_shadow=False)
        self._robot = server.scene.add_frame(f"/{ROBOT}", show_axes=False)
        self._nodes: list[Any] = [self._add_body(*body) for body in bodies]
        self._in_robot = np.array([name.startswith(f"{ROBOT}/") for name, _ in bodies])
        self._marks = [self._add_mark(n, color) for n, color in enumerate(marks)]
        self._base = np.full(7, np.inf)
        self._poses = np.full((len(bodies), 7), np.inf)
        self._touching = False

    def show(self, base: Floats, poses: Floats, marks_m: Floats, contacts_m: Floats) -> None:
        """Moves everything.

        Args:
            base: x [m], y [m] and yaw [rad] of the robot's base (3,).
            poses: Position [m] and quaternion (w, x, y, z) of each body in the world (B, 7).
            marks_m: Tips of the arrows (M, 3).
            contacts_m: Points where the robot touches other bodies (C, 3).
        """
        pose = np.array(planar(*map(float, base)))
        if np.abs(pose - self._base).max() > MOVED:
            self._base = pose
            _move(self._robot, pose)
        poses = poses.copy()
        # Links move with the robot, so that only what moves in it is sent.
        poses[self._in_robot] = _seen_from(self._base, poses[self._in_robot])
        moved = np.abs(poses - self._poses).max(axis=1) > MOVED
        for row in np.flatnonzero(moved):
            self._poses[row] = poses[row]
            _move(self._nodes[row], poses[row])
        for node, tip_m in zip(self._marks, marks_m, strict=True):
            node.position = tip_m
        self._show_contacts(contacts_m)

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
