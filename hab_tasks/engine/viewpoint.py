"""Human renderings: a camera with a clear view of the hand, and marker arrows.

The agent's sensors never see the arrows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import sapien
import trimesh
from mani_skill.envs.scene import ManiSkillScene
from mani_skill.utils.sapien_utils import look_at

from hab_tasks.engine.episode_simulation import EpisodeSimulation
from hab_tasks.geometry import apply, planar
from hab_tasks.privileged import Array
from hab_tasks.robots.cameras import HiddenVisuals

Hit = tuple[float, str]
"""Distance [m] of a ray's hit, and the name of the body."""

CastRay = Callable[[Array, Array, float], Hit | None]
"""(origin (3,), unit direction (3,), length [m]) -> the first hit, or None."""

LOOK_AT_M = (0.7, 0.0, 0.75)
CANDIDATES_M = tuple(
    (x, side * y, z)
    for x, y, z in (
        *((-1.4, 1.1, 2.1), (-0.5, 1.7, 2.1), (0.9, 1.7, 2.1), (-0.9, 0.8, 2.1), (-0.2, 1.2, 2.1)),
        *((-0.45, 0.35, 2.1), (0.2, 0.9, 1.5), (0.1, 0.3, 2.3), (0.0, 0.6, 0.9), (0.3, 0.3, 0.75)),
    )
    for side in (1, -1)
)
"""Camera positions in the base frame, best first; the last ones look over the shoulder, down from
above, and into the furniture ahead of the robot."""

FIELD_OF_VIEW_RAD = 1.2

_MARGIN_M = 0.15
"""Clearance behind the camera."""

_SKIN_M = 0.02


def _pose(candidate: int) -> sapien.Pose:
    return look_at(CANDIDATES_M[candidate], LOOK_AT_M).sp


FIRST_VIEW = _pose(0)


class Viewpoint:
    """Chooses the camera position; it moves with the base until the hand is occluded."""

    def __init__(self) -> None:
        self._episode, self._chosen = "", 0

    def follow(self, world: EpisodeSimulation, cast: CastRay) -> sapien.Pose | None:
        """Returns the camera's new pose in the base frame; None to keep the current one.

        `cast` casts a ray against all bodies, open doors included.
        """
        snapshot = world.snapshot
        base = np.asarray(snapshot.base[0], dtype=float)
        hand_m = np.asarray(snapshot.ee_m[0], dtype=float)
        robot, held = world.robot, world.held_name()
        # The last two joints are the wrist's. ManiSkill prefixes names of actors: ``scene-0_NAME``.
        hand = (*robot.arm_links[-2:], robot.ee_link, *robot.finger_links)
        hand += () if held is None else (held,)
        new = world.episode.id != self._episode
        if not new and _sees(self._chosen, base, hand_m, hand, cast):
            return None
        self._episode = world.episode.id
        seeing = (i for i in range(len(CANDIDATES_M)) if _sees(i, base, hand_m, hand, cast))
        found = next(seeing, None)
        if found is None:  # the first candidate outside walls, else the current one
            found = next(
                (i for i in range(len(CANDIDATES_M)) if _stands_free(i, base, cast)), self._chosen
            )
        if found == self._chosen and not new:
            return None
        self._chosen = found
        return _pose(found)


def in_world(candidate: int, base: Array) -> Array:
    """Returns a candidate's position (3,) in the world, at a base (3,): x, y [m], yaw [rad]."""
    return _to_world(np.array(CANDIDATES_M[candidate]), base)


def _sees(candidate: int, base: Array, hand_m: Array, hand: tuple[str, ...], cast: CastRay) -> bool:
    """Returns whether the hand is in view; bodies named in `hand` do not count as occluding it."""
    camera_m = in_world(candidate, base)
    ahead = _to_world(np.array(LOOK_AT_M), base) - camera_m
    ahead = ahead / np.linalg.norm(ahead)
    way_m = hand_m - camera_m
    distance_m = float(np.linalg.norm(way_m))
    # Half the field of view is the edge of the picture; a little less keeps the hand off it.
    in_picture = float(ahead @ way_m) > distance_m * np.cos(0.45 * FIELD_OF_VIEW_RAD)
    if not in_picture or not _stands_free(candidate, base, cast):
        return False
    hit = cast(camera_m, way_m / distance_m, distance_m)
    if hit is None or hit[0] > distance_m - _SKIN_M:
        return True
    return hit[1].endswith(hand)


def _stands_free(candidate: int, base: Array, cast: CastRay) -> bool:
    """Returns whether the path from the robot's head to just behind the camera is free."""
    camera_m = in_world(candidate, base)
    height_m = max(1.3, float(camera_m[2]))  # above the robot's head, which is 1.1 m high
    above_m = np.array((*base[:2], height_m))
    over_m = np.array((*camera_m[:2], height_m))
    for start_m, end_m in ((above_m, over_m), (over_m, camera_m)):
        way_m = end_m - start_m
        length_m = float(np.linalg.norm(way_m))
        if length_m > 0 and cast(start_m, way_m / length_m, length_m + _MARGIN_M) is not None:
            return False
    return True


def _to_world(point_m: Array, base: Array) -> Array:
    return apply(planar(*base.tolist()), point_m)


TARGET_COLOR = (0.9, 0.2, 0.0)
GOAL_COLOR = (0.0, 0.6, 0.05)
HANDLE_COLOR = (0.0, 0.15, 0.9)

TIP_M = {TARGET_COLOR: 0.13, GOAL_COLOR: 0.05, HANDLE_COLOR: 0.04}
"""Height of an arrow's tip above the marked point; the centre of a tall object is 11 cm below its
top."""

_HEAD_M, _HEAD_RADIUS_M = 0.12, 0.04
_SHAFT_M, _SHAFT_RADIUS_M = 0.5, 0.012
_APART_M = 1e-3


class Marks(HiddenVisuals):
    """Arrows over targets, goals and handles.

    They are visual only: no collision shapes, and not part of the simulation state.
    """

    def __init__(self, scene: ManiSkillScene) -> None:
        """Adds the arrows to the first sub-scene."""
        self._scene = scene.sub_scenes[0]
        self._arrows: list[sapien.Entity] = []
        self._visuals = []
        self._colors: list[tuple[float, float, float]] = []

    def place(self, world: EpisodeSimulation) -> None:
        """Moves the arrows to the current positions."""
        colors = [color for color, _ in marked_points(world)]
        if colors != self._colors:
            self._make(colors)
        for entity, tip_m in zip(self._arrows, tips_m(world), strict=True):
            entity.set_pose(sapien.Pose(tip_m))

    def _make(self, colors: list[tuple[float, float, float]]) -> None:
        for entity in self._arrows:
            entity.remove_from_scene()
        made = [_arrow(color) for color in colors]
        self._arrows, self._visuals = [entity for entity, _ in made], [visual for _, visual in made]
        self._colors = colors
        for entity in self._arrows:
            self._scene.add_entity(entity)


def marked_points(world: EpisodeSimulation) -> Iterable[tuple[tuple[float, float, float], Array]]:
    """Yields colour and the marked point in the world (3,) [m] of each mark."""
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


def tips_m(world: EpisodeSimulation) -> Array:
    """Returns the tips (M, 3) [m] of the arrows over the marks."""
    tips = [(*at[:2], at[2] + TIP_M[color]) for color, at in marked_points(world)]
    return np.array(tips, dtype=float).reshape(-1, 3)


def arrow_mesh() -> Any:
    """Returns the mesh of an arrow that points down, with its tip at the origin."""
    head = trimesh.creation.cone(radius=_HEAD_RADIUS_M, height=_HEAD_M)
    head.apply_transform(trimesh.transformations.rotation_matrix(np.pi, (1, 0, 0)))
    head.apply_translation((0, 0, _HEAD_M))
    shaft = trimesh.creation.cylinder(radius=_SHAFT_RADIUS_M, height=_SHAFT_M)
    shaft.apply_translation((0, 0, _HEAD_M + _SHAFT_M / 2))
    return trimesh.util.concatenate([head, shaft])


def _arrow(
    color: tuple[float, float, float],
) -> tuple[sapien.Entity, sapien.render.RenderBodyComponent]:
    """Returns an arrow as an entity, and its visual."""
    mesh = arrow_mesh()
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
    # ManiSkill shows `_hidden_objects` while a human-render camera takes its picture.
    visual.visibility = 0.0
    entity = sapien.Entity()
    entity.name = "mark"
    entity.add_component(visual)
    return entity, visual
