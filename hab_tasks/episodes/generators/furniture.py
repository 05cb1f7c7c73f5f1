"""What the generators of doors and drawers share: handles, and the floor in front of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hab_tasks.episodes.refusal import RefusedError
from hab_tasks.episodes.schema import HandleRef, template_of
from hab_tasks.episodes.workbench import Workbench
from hab_tasks.geometry import Array
from hab_tasks.scenes.markers import HANDLE_MARKERS, HandleMarker


@dataclass(frozen=True, kw_only=True)
class Front:
    """A door or drawer in a layout.

    Attributes:
        ref: Furniture, joint and marker.
        marker: Where its handle is.
    """

    ref: HandleRef
    marker: HandleMarker

    def handle_m(self, bench: Workbench) -> Array:
        """Returns the handle (3,) in the world, as the furniture stands now."""
        return marker_m(bench, self.ref.furniture, self.marker)


def marker_m(bench: Workbench, furniture: str, marker: HandleMarker) -> Array:
    """Returns a handle marker (3,) in the world, as the furniture stands now."""
    scale = {a.name: a.scale for a in bench.spec.articulations}[furniture]
    world_from_link = bench.world_from(f"{furniture}/{marker.link}")
    return world_from_link[:3, :3] @ (scale * np.array(marker.offset_m)) + world_from_link[:3, 3]


def handles_m(bench: Workbench) -> Array:
    """Returns every handle (H, 3) of the layout in the world, as the furniture stands now."""
    points = [
        marker_m(bench, furniture, marker)
        for furniture in bench.handles.articulations
        for marker in HANDLE_MARKERS
        if marker.template == template_of(furniture)
    ]
    return np.array(points).reshape(-1, 3)


def find_front(bench: Workbench, marker_name: str) -> Front:
    """Returns the door or drawer with a handle marker of this name.

    Raises:
        RefusedError: The layout has none.
    """
    markers = [m for m in HANDLE_MARKERS if m.name == marker_name]
    for marker in markers:
        furniture = bench.furniture(marker.template)
        joint = bench.joint_of(furniture, marker.link) if furniture else None
        if furniture is not None and joint is not None:
            ref = HandleRef(furniture=furniture, joint=joint, marker=marker.name)
            return Front(ref=ref, marker=marker)
    raise RefusedError(f"no {markers[0].template} in the layout")


def other_drawers(bench: Workbench, front: Front) -> list[str]:
    """Returns the joints of the other drawers with handles in the same piece of furniture."""
    template = template_of(front.ref.furniture)
    links = [m.link for m in HANDLE_MARKERS if m.template == template and m != front.marker]
    joints = [bench.joint_of(front.ref.furniture, link) for link in sorted(links)]
    return [joint for joint in joints if joint is not None]


def level_frame(origin_m: Array, ahead: Array) -> Array:
    """Returns the (4, 4) upright frame at a point whose x axis is `ahead` (3,), made level."""
    x = np.array([ahead[0], ahead[1], 0.0])
    x = x / np.linalg.norm(x)
    frame = np.eye(4)
    frame[:3, 0], frame[:3, 1] = x, np.array([-x[1], x[0], 0.0])
    frame[:3, 3] = origin_m
    return frame
