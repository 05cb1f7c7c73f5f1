"""Start of an episode: validation against its environment and layout, and its start state."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from mani_skill.utils.structs import Actor

from hab_tasks.engine.goals import Requirements
from hab_tasks.episodes.schema import Episode
from hab_tasks.errors import EpisodeError
from hab_tasks.geometry import BOX_CORNERS, Pose7, apply
from hab_tasks.option_values import LARGEST_SEED
from hab_tasks.robots.mobile_manipulator import MobileManipulator
from hab_tasks.robots.spec import RobotSpec
from hab_tasks.simulator import rigid_body, sapien_object
from hab_tasks.world.scenes.build import to_sapien
from hab_tasks.world.scenes.meshes import mesh_bounds
from hab_tasks.world.scenes.pool import SceneBodies
from hab_tasks.world.scenes.spec import Stage

FARTHEST_M = 1000.0
"""Largest valid coordinate; beyond it, float32 resolves less than 0.1 mm."""

JOINT_TOLERANCE = 1e-3
"""Tolerance of joint limits [m or rad], for rounding."""

Limits = tuple[float, float]
Area = tuple[float, float, float, float]


def check_entries(
    episode: Episode, robot: RobotSpec, requirements: Requirements, file: Path | None = None
) -> None:
    """Checks that an episode has the fields an environment requires, in any layout.

    Raises:
        EpisodeError: With the `file`, the episode, the field and the valid values.
    """
    for field, fault in _faults(episode, robot, requirements):
        where = episode.id if file is None else f"{file}: episode {episode.id!r}"
        raise EpisodeError(f"{where}, field {field}: {fault}.")


def _faults(
    episode: Episode, robot: RobotSpec, requirements: Requirements
) -> Iterator[tuple[str, str]]:
    """Yields invalid fields, each with a description."""
    found, wanted = len(episode.targets), requirements.objects
    if found != wanted:
        yield "targets", f"{found} objects to rearrange, expected {wanted}"
    for number, target in enumerate(episode.targets):
        if target.object not in episode.objects:
            yield "targets", f"{target.object!r} is not among the objects"
        if requirements.goals and target.world_from_goal is None:
            yield f"targets[{number}].world_from_goal", "missing, required by this environment"
    if requirements.holds and episode.held is None:
        yield "held", "missing: the object starts in the grasp"
    if requirements.holds and episode.held != episode.target:
        yield "held", f"{episode.held!r}, expected the target {episode.target!r}"
    if episode.held is not None and episode.held not in episode.objects:
        yield "held", f"{episode.held!r} is not among the objects"
    if requirements.names_articulation and episode.handle is None:
        yield ("handle", f"missing: the handle of the {requirements.articulations[0].name}")
    if requirements.names_navigation_goal and episode.navigation is None:
        yield "navigation", "missing: the navigation goal of the base"
    if set(episode.robot.arm_qpos_rad) != set(robot.arm_joints):
        found, expected = sorted(episode.robot.arm_qpos_rad), ", ".join(robot.arm_joints)
        yield "robot.arm_qpos_rad", f"joints {', '.join(found)}, expected {expected}"
    if not 0 <= episode.seed <= LARGEST_SEED:
        yield "seed", f"{episode.seed} is not within 0 to 2^63 - 1"
    for field, values in _coordinates(episode):
        # Put this way, NaN is refused as well; so are joints below.
        if not all(abs(value) <= FARTHEST_M for value in values):
            yield field, f"{list(values)} is not within {FARTHEST_M:g} m of the origin"


def _coordinates(episode: Episode) -> Iterator[tuple[str, Iterable[float]]]:
    """Yields each field with coordinates, and their values [m or rad]."""
    yield "robot.base", episode.robot.base
    yield "robot.arm_qpos_rad", episode.robot.arm_qpos_rad.values()
    if episode.navigation is not None:
        yield "navigation.base", episode.navigation.base
    for kind, poses in (("objects", episode.objects), ("loose", episode.loose)):
        for name, pose in poses.items():
            yield f"{kind}.{name}", pose
    for number, target in enumerate(episode.targets):
        if target.world_from_goal is not None:
            yield f"targets[{number}].world_from_goal", target.world_from_goal


def check_in_layout(episode: Episode, scene_bodies: SceneBodies) -> None:
    """Checks that the objects, joints and poses of an episode exist in its active layout.

    Raises:
        EpisodeError: With the episode, the field and the valid values.
    """
    layout = f"the layout {episode.scene_id}"
    shown = {
        "objects": scene_bodies.pickables,
        "loose": scene_bodies.loose,
        "joints": scene_bodies.articulations,
    }
    for field, there in shown.items():
        unknown = sorted(set(getattr(episode, field)) - set(there))
        if unknown:
            raise EpisodeError(f"{episode.id}, field {field}: no {unknown[0]!r} in {layout}.")
    for furniture, joints in episode.joints.items():
        limits = _limits(scene_bodies, furniture)
        for joint, position in joints.items():
            _check_joint(f"{episode.id}, field joints.{furniture}", limits, joint, position)
    ref = episode.handle
    if ref is not None:
        if ref.furniture not in scene_bodies.articulations:
            raise EpisodeError(f"{episode.id}, field handle: no {ref.furniture!r} in {layout}.")
        _check_joint(f"{episode.id}, field handle", _limits(scene_bodies, ref.furniture), ref.joint)
    bases = {"robot.base": episode.robot.base}
    if episode.navigation is not None:
        bases["navigation.base"] = episode.navigation.base
    low_x, low_y, high_x, high_y = _area(scene_bodies.spec.stage)
    for field, (x, y, _) in bases.items():
        if not (low_x <= x <= high_x and low_y <= y <= high_y):
            raise EpisodeError(
                f"{episode.id}, field {field}: ({x:g}, {y:g}) is outside {layout}, which extends "
                f"from ({low_x:.1f}, {low_y:.1f}) to ({high_x:.1f}, {high_y:.1f})."
            )


def _limits(scene_bodies: SceneBodies, furniture: str) -> dict[str, Limits]:
    """Returns joint name -> limits [m or rad]."""
    body = scene_bodies.articulations[furniture]
    names, joints = (joint.name for joint in body.active_joints), sapien_object(body).active_joints
    return {
        name: (float(joint.limits[0][0]), float(joint.limits[0][1]))
        for name, joint in zip(names, joints, strict=True)
    }


def _check_joint(
    where: str, limits: dict[str, Limits], joint: str, position: float | None = None
) -> None:
    if joint not in limits:
        raise EpisodeError(f"{where}: no joint {joint!r}; valid joints are {sorted(limits)}.")
    low, high = limits[joint]
    if position is not None and not low - JOINT_TOLERANCE <= position <= high + JOINT_TOLERANCE:
        raise EpisodeError(f"{where}: {joint} at {position:g} is not within {low:g} to {high:g}.")


@lru_cache(maxsize=128)
def _area(stage: Stage) -> Area:
    """Returns min x, min y, max x, max y [m] of the stage mesh (floor and walls)."""
    corners = np.concatenate([_corners(stage.world_from_stage, *box) for box in _boxes(stage)])
    (low_x, low_y), (high_x, high_y) = corners.min(axis=0), corners.max(axis=0)
    return float(low_x), float(low_y), float(high_x), float(high_y)


def _boxes(stage: Stage) -> Iterator[tuple[Iterable[float], Iterable[float]]]:
    """Yields centre and half size [m] of the stage mesh's parts, in its own frame."""
    for part in stage.collision:
        if part.file is None:
            yield part.center_m, part.half_size_m
        else:
            yield mesh_bounds(part.file)


def _corners(
    world_from_stage: Pose7, center_m: Iterable[float], half_m: Iterable[float]
) -> np.ndarray:
    """Returns the xy coordinates (8, 2) of a box's corners."""
    points = np.array(tuple(center_m)) + BOX_CORNERS * np.array(tuple(half_m))
    return np.array([apply(world_from_stage, point) for point in points])[:, :2]


def apply_episode(
    episode: Episode,
    scene_bodies: SceneBodies,
    agent: MobileManipulator,
    in_place: frozenset[str] = frozenset(),
) -> None:
    """Sets furniture, objects and robot to the start state of a checked episode, at rest.

    Loose objects in `in_place` are already at their start poses.
    """
    _apply_joints(episode, scene_bodies)
    _apply_objects(episode, scene_bodies, in_place)
    _apply_robot(episode, agent)


def _apply_joints(episode: Episode, scene_bodies: SceneBodies) -> None:
    for name, furniture in scene_bodies.articulations.items():
        index = {joint.name: i for i, joint in enumerate(furniture.active_joints)}
        # Closed unless the episode opens it: an earlier one may have left it open.
        qpos = torch.zeros(1, len(index), device=furniture.device)
        for joint, value in episode.joints.get(name, {}).items():
            qpos[0, index[joint]] = value
        furniture.set_qpos(qpos)
        furniture.set_qvel(torch.zeros_like(qpos))


def _apply_objects(episode: Episode, scene_bodies: SceneBodies, in_place: frozenset[str]) -> None:
    for name, actor in scene_bodies.pickables.items():
        _place(actor, episode.objects[name])
    # Loose objects that the episode does not name stand where the layout has them.
    starts = {o.name: o.world_from_object for o in scene_bodies.spec.objects if o.dynamic}
    for name, actor in scene_bodies.loose.items():
        if name not in in_place:
            _place(actor, episode.loose.get(name, starts[name]))


def _place(actor: Actor, pose: Pose7) -> None:
    body: Any = rigid_body(actor)
    body.entity.pose = to_sapien(pose)
    # PhysX refuses velocities of a kinematic body, which has none.
    if not body.kinematic:
        body.linear_velocity = body.angular_velocity = (0.0, 0.0, 0.0)


def _apply_robot(episode: Episode, agent: MobileManipulator) -> None:
    # Torso, head and fingers are fixed, and not part of an episode.
    qpos = agent.rest_qpos()[None]
    qpos[0, agent.base_index] = torch.tensor(episode.robot.base, device=agent.device)
    for name, value in episode.robot.arm_qpos_rad.items():
        qpos[0, agent.joint_index[name]] = value
    agent.robot.set_qpos(qpos)
    agent.robot.set_qvel(torch.zeros_like(qpos))
