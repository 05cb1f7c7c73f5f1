"""Bars for the handles of doors and drawers that two fingers could not hold.

ReplicaCAD draws the handles of its drawers and fridge, but their collision shapes are plain boxes,
which the snap grasp can hold. For a grasp by friction these get a bar, as the apartment's have.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hab_tasks.articulations import HANDLE_MARKERS, HandleMarker
from hab_tasks.geometry import IDENTITY
from hab_tasks.privileged import Array
from hab_tasks.world.scenes.layout_geometry import RigidShapes, furniture_model
from hab_tasks.world.scenes.spec import ArticulationInstance, HandleBar, SceneSpec

AHEAD_M = 0.0385
"""Distance of an added bar from the link's front: that of the apartment's bars."""

THICKEST_M = 0.06
"""Maximum size of a shape across a bar, below the opening of the fingers."""

NEAR_M = 0.015
"""Maximum distance of a bar from the marker of its handle."""


def with_bars(spec: SceneSpec) -> SceneSpec:
    """Returns a layout in which every handle has a bar."""
    return replace(spec, articulations=tuple(map(_with_bars, spec.articulations)))


def _with_bars(furniture: ArticulationInstance) -> ArticulationInstance:
    markers = [one for one in HANDLE_MARKERS if one.template == furniture.template]
    if not markers:
        return furniture
    alone = replace(furniture, name=furniture.template, world_from_root=IDENTITY, scale=1.0)
    shapes = {link.name: link.shapes for link in furniture_model(alone).links}
    bars = [_bar(marker, shapes[marker.link]) for marker in markers]
    return replace(furniture, bars=tuple(bar for bar in bars if bar is not None))


def _bar(marker: HandleMarker, shapes: RigidShapes) -> HandleBar | None:
    """Returns the bar that a handle needs; None if it has one."""
    corners = np.split(shapes.points[:3], shapes.starts[1:], axis=1)
    if any(_is_bar(one, np.array(marker.offset_m)) for one in corners):
        return None
    front_m, (_, y, z) = float(shapes.points[0].max()), marker.offset_m
    middle_m = (front_m + AHEAD_M, y, z)
    return HandleBar(link=marker.link, middle_m=middle_m, length_m=marker.bar_m, front_m=front_m)


def _is_bar(corners_m: Array, marker_m: Array) -> bool:
    """Whether a shape with corners (3, P) is a bar at a point (3,) of the link."""
    low, high = corners_m.min(axis=1), corners_m.max(axis=1)
    here = np.all((low - NEAR_M <= marker_m) & (marker_m <= high + NEAR_M))
    return bool(here and (high - low)[:2].max() <= THICKEST_M)
