"""Writes an episode's start state to the simulation."""

from __future__ import annotations

from typing import Any

import sapien
import torch
from mani_skill.utils.structs import Actor

from hab_tasks.episodes.schema import Episode
from hab_tasks.geometry import Pose7
from hab_tasks.robots.mobile_manipulator import MobileManipulator
from hab_tasks.simulator import rigid_body
from hab_tasks.world.scenes.scene_bodies import SceneBodies


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
        qpos = torch.zeros(1, len(index), device=furniture.device)
        for joint, value in episode.joints.get(name, {}).items():
            qpos[0, index[joint]] = value
        furniture.set_qpos(qpos)
        furniture.set_qvel(torch.zeros_like(qpos))


def _apply_objects(episode: Episode, scene_bodies: SceneBodies, in_place: frozenset[str]) -> None:
    for name, actor in scene_bodies.pickables.items():
        _place(actor, episode.objects[name])
    starts = {o.name: o.world_from_object for o in scene_bodies.spec.objects if o.dynamic}
    for name, actor in scene_bodies.loose.items():
        if name not in in_place:
            _place(actor, episode.loose.get(name, starts[name]))


def _place(actor: Actor, pose: Pose7) -> None:
    body: Any = rigid_body(actor)
    body.entity.pose = sapien.Pose(list(pose[:3]), list(pose[3:]))
    if not body.kinematic:
        body.linear_velocity = body.angular_velocity = (0.0, 0.0, 0.0)


def _apply_robot(episode: Episode, agent: MobileManipulator) -> None:
    qpos = agent.rest_qpos()[None]
    qpos[0, agent.base_index] = torch.tensor(episode.robot.base, device=agent.device)
    for name, value in zip(agent.spec.arm_joints, episode.robot.arm_qpos_rad, strict=True):
        qpos[0, agent.joint_index[name]] = value
    agent.robot.set_qpos(qpos)
    agent.robot.set_qvel(torch.zeros_like(qpos))
