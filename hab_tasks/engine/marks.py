"""Marker arrows in human renderings; never visible to the agent's sensors."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import sapien
import trimesh
from mani_skill.envs.scene import ManiSkillScene

from hab_tasks.engine.episode_simulation import EpisodeSimulation
from hab_tasks.privileged import Array

TARGET_COLOR = (0.9, 0.2, 0.0)
GOAL_COLOR = (0.0, 0.6, 0.05)
HANDLE_COLOR = (0.0, 0.15, 0.9)

_TIP_M = {TARGET_COLOR: 0.13, GOAL_COLOR: 0.05, HANDLE_COLOR: 0.04}
"""Height of an arrow's tip above the marked point; the centre of a tall object is 11 cm below its
top."""

_HEAD_M, _HEAD_RADIUS_M = 0.12, 0.04
_SHAFT_M, _SHAFT_RADIUS_M = 0.5, 0.012
_APART_M = 1e-3


class Marks:
    """Arrows over targets, goals and handles.

    They are visual only: no collision shapes, and not part of the simulation state. ManiSkill calls
    `hide_visual` of its `_hidden_objects` before it renders sensors, and `show_visual` before it
    renders for humans.
    """

    def __init__(self, scene: ManiSkillScene) -> None:
        """Adds the arrows to the first sub-scene."""
        self._scene = scene.sub_scenes[0]
        self._arrows: list[tuple[sapien.Entity, sapien.render.RenderBodyComponent]] = []
        self._colors: list[tuple[float, float, float]] = []

    def place(self, world: EpisodeSimulation) -> None:
        """Moves the arrows to the current positions."""
        points = list(marked_points(world))
        colors = [color for color, _ in points]
        if colors != self._colors:
            self._make(colors)
        for (entity, _), (color, point_m) in zip(self._arrows, points, strict=True):
            entity.set_pose(sapien.Pose([*point_m[:2], point_m[2] + _TIP_M[color]]))

    def hide_visual(self) -> None:
        """Hides the arrows."""
        for _, visual in self._arrows:
            visual.visibility = 0.0

    def show_visual(self) -> None:
        """Shows the arrows."""
        for _, visual in self._arrows:
            visual.visibility = 1.0

    def _make(self, colors: list[tuple[float, float, float]]) -> None:
        for entity, _ in self._arrows:
            entity.remove_from_scene()
        self._arrows, self._colors = [_arrow(color) for color in colors], colors
        for entity, _ in self._arrows:
            self._scene.add_entity(entity)


def marked_points(world: EpisodeSimulation) -> Iterable[tuple[tuple[float, float, float], Array]]:
    """Yields colour and world position (3,) [m] of each mark."""
    snapshot, goals = world.snapshot, world.goals
    for number in range(world.requirements.objects):
        start_m, goal_m = goals.starts_m[0][number], goals.goals_m[0][number]
        yield TARGET_COLOR, np.asarray(snapshot.objects_m[0][number], dtype=float)
        if np.linalg.norm(np.asarray(goal_m) - np.asarray(start_m)) > _APART_M:
            yield GOAL_COLOR, np.asarray(goal_m, dtype=float)
    for handle_m in snapshot.handles_m[0]:
        yield HANDLE_COLOR, np.asarray(handle_m, dtype=float)
    if world.requirements.navigates and world.episode.navigation is not None:
        x, y, _ = np.asarray(goals.base[0], dtype=float)
        yield GOAL_COLOR, np.array((x, y, 0.0))


def _arrow(
    color: tuple[float, float, float],
) -> tuple[sapien.Entity, sapien.render.RenderBodyComponent]:
    """Returns an arrow that points down, with its tip at the origin."""
    head = trimesh.creation.cone(radius=_HEAD_RADIUS_M, height=_HEAD_M)
    head.apply_transform(trimesh.transformations.rotation_matrix(np.pi, (1, 0, 0)))
    head.apply_translation((0, 0, _HEAD_M))
    shaft = trimesh.creation.cylinder(radius=_SHAFT_RADIUS_M, height=_SHAFT_M)
    shaft.apply_translation((0, 0, _HEAD_M + _SHAFT_M / 2))
    mesh: Any = trimesh.util.concatenate([head, shaft])
    # Emissive, so that it is as bright inside a cupboard as outside.
    material = sapien.render.RenderMaterial(
        emission=[*color, 1.0], base_color=[0.0, 0.0, 0.0, 1.0], roughness=1.0
    )
    visual = sapien.render.RenderBodyComponent()
    visual.attach(
        sapien.render.RenderShapeTriangleMesh(
            vertices=np.asarray(mesh.vertices, dtype=np.float32),
            triangles=np.asarray(mesh.faces, dtype=np.uint32),
            normals=np.asarray(mesh.vertex_normals, dtype=np.float32),
            uvs=np.zeros((len(mesh.vertices), 2), dtype=np.float32),
            material=material,
        )
    )
    visual.visibility = 0.0
    entity = sapien.Entity()
    entity.name = "mark"
    entity.add_component(visual)
    return entity, visual
