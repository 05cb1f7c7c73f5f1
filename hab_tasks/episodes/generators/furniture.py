"""Shared by the generators of doors and drawers: handles, and the floor ahead of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hab_tasks.articulations import HANDLE_MARKERS, HandleMarker
from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.schema import HandleRef, rounded, template_of
from hab_tasks.errors import RejectedSampleError
from hab_tasks.geometry import Array, Pose7, from_matrix, to_matrix

HEADROOM_M = 0.002
"""Clearance above the content of a drawer, which tilts slightly when pushed."""

STATIONS = 11
"""Number of tested positions along a drawer's travel; no tall part is thinner than a step."""


@dataclass(frozen=True, kw_only=True)
class LayoutArticulation:
    """A door or drawer in a layout, and its handle marker."""

    ref: HandleRef
    marker: HandleMarker

    def handle_m(self, sandbox: PlacementSandbox) -> Array:
        """Returns the current handle position (3,) in the world."""
        return marker_m(sandbox, self.ref.furniture, self.marker)


def marker_m(sandbox: PlacementSandbox, furniture: str, marker: HandleMarker) -> Array:
    """Returns the current position (3,) of a handle marker in the world."""
    instance = next(one for one in sandbox.spec.articulations if one.name == furniture)
    world_from_link = sandbox.world_from(f"{furniture}/{marker.link}")
    return world_from_link[:3, :3] @ np.array(instance.handle_m(marker)) + world_from_link[:3, 3]


def handles_m(sandbox: PlacementSandbox) -> Array:
    """Returns the current positions (H, 3) of all handles of the layout in the world."""
    points = [
        marker_m(sandbox, furniture, marker)
        for furniture in sandbox.scene_bodies.articulations
        for marker in HANDLE_MARKERS
        if marker.template == template_of(furniture)
    ]
    return np.array(points).reshape(-1, 3)


def handle_at(
    sandbox: PlacementSandbox, articulation: LayoutArticulation, position: float
) -> Array:
    """Returns the handle position (3,) in the world at a joint position [m or rad]."""
    before = joint_position(sandbox, articulation)
    sandbox.set_joint(articulation.ref.furniture, articulation.ref.joint, position)
    handle_m = articulation.handle_m(sandbox)
    sandbox.set_joint(articulation.ref.furniture, articulation.ref.joint, before)
    return handle_m


def joint_position(sandbox: PlacementSandbox, articulation: LayoutArticulation) -> float:
    """Returns the current joint position [m or rad]."""
    joints = sandbox.joints().get(articulation.ref.furniture, {})
    return joints.get(articulation.ref.joint, 0.0)


def find_articulation(sandbox: PlacementSandbox, marker_name: str) -> LayoutArticulation:
    """Returns the door or drawer with a handle marker of this name.

    Raises:
        RejectedSampleError: The layout has no such marker.
    """
    markers = [m for m in HANDLE_MARKERS if m.name == marker_name]
    for marker in markers:
        furniture = sandbox.furniture(marker.template)
        joint = sandbox.joint_of(furniture, marker.link) if furniture else None
        if furniture is not None and joint is not None:
            ref = HandleRef(furniture=furniture, joint=joint, marker=marker.name)
            return LayoutArticulation(ref=ref, marker=marker)
    raise RejectedSampleError(f"no {markers[0].template} in the layout")


def other_drawers(sandbox: PlacementSandbox, articulation: LayoutArticulation) -> list[str]:
    """Returns the joints of the other drawers with handles in the same piece of furniture."""
    template = template_of(articulation.ref.furniture)
    links = [m.link for m in HANDLE_MARKERS if m.template == template and m != articulation.marker]
    joints = [sandbox.joint_of(articulation.ref.furniture, link) for link in sorted(links)]
    return [joint for joint in joints if joint is not None]


def level_frame(origin_m: Array, ahead: Array) -> Array:
    """Returns the (4, 4) upright frame at a point; x is the horizontal part of `ahead` (3,)."""
    x = np.array([ahead[0], ahead[1], 0.0])
    x = x / np.linalg.norm(x)
    frame = np.eye(4)
    frame[:3, 0], frame[:3, 1] = x, np.array([-x[1], x[0], 0.0])
    frame[:3, 3] = origin_m
    return frame


def slides(
    sandbox: PlacementSandbox, objects: dict[str, Pose7], articulation: LayoutArticulation
) -> bool:
    """Whether a drawer with content slides over its whole travel, with the other furniture as is.

    All of `objects` are in the drawer; objects and drawer are restored.
    """
    low_m, high_m = sandbox.joint_limits(articulation.ref.furniture, articulation.ref.joint)
    before = joint_position(sandbox, articulation)
    free, poses = True, objects
    for position in np.linspace(low_m, high_m, STATIONS):
        poses = carried(sandbox, poses, articulation, float(position))
        for name, pose in poses.items():
            sandbox.place(name, (*pose[:2], pose[2] + HEADROOM_M, *pose[3:]))
        free = free and not any(sandbox.touching(name) for name in objects)
    sandbox.set_joint(articulation.ref.furniture, articulation.ref.joint, before)
    for name, pose in objects.items():
        sandbox.place(name, pose)
    return free


def carried(
    sandbox: PlacementSandbox,
    objects: dict[str, Pose7],
    articulation: LayoutArticulation,
    position: float,
) -> dict[str, Pose7]:
    """Moves a drawer [m]; returns the new poses of `objects`, which are all in it."""
    link = f"{articulation.ref.furniture}/{articulation.marker.link}"
    before = sandbox.world_from(link)
    sandbox.set_joint(articulation.ref.furniture, articulation.ref.joint, position)
    moved = sandbox.world_from(link) @ np.linalg.inv(before)
    return {name: rounded(from_matrix(moved @ to_matrix(pose))) for name, pose in objects.items()}
