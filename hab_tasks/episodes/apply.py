"""Writes an episode's start state into one row of the simulation."""

from __future__ import annotations

import torch
from mani_skill.utils.structs import Actor
from mani_skill.utils.structs.pose import Pose

from hab_tasks.episodes.schema import Episode
from hab_tasks.errors import EpisodeError
from hab_tasks.geometry import Pose7
from hab_tasks.robots.fetch import HabFetch
from hab_tasks.robots.fetch_spec import ARM_JOINTS
from hab_tasks.scenes.build import parking_pose
from hab_tasks.scenes.handles import SceneHandles


def apply_episode(episode: Episode, row: int, handles: SceneHandles, agent: HabFetch) -> None:
    """Poses furniture, objects and robot in `row`; everything at rest.

    Args:
        episode: What to write.
        row: The row of the simulation; `handles` must have been built there.
        handles: The layout of `episode.scene_id`.
        agent: The robot.

    Raises:
        EpisodeError: The episode names furniture, a joint or an object that is not there.
    """
    scene = agent.scene
    mask = scene._reset_mask
    scene._reset_mask = torch.zeros_like(mask)
    scene._reset_mask[row] = True
    try:
        _apply_joints(episode, handles)
        _apply_objects(episode, handles)
        _apply_robot(episode, agent)
    finally:
        scene._reset_mask = mask


def _apply_joints(episode: Episode, handles: SceneHandles) -> None:
    unknown = set(episode.joints) - set(handles.articulations)
    if unknown:
        raise EpisodeError(f"{episode.id}: no furniture {sorted(unknown)} in {episode.scene_id}.")
    for name, furniture in handles.articulations.items():
        index = {joint.name: i for i, joint in enumerate(furniture.active_joints)}
        qpos = torch.zeros(1, len(index), device=furniture.device)
        for joint, value in episode.joints.get(name, {}).items():
            if joint not in index:
                raise EpisodeError(f"{episode.id}: {name} has no joint {joint!r}: {sorted(index)}.")
            qpos[0, index[joint]] = value
        furniture.set_qpos(qpos)
        furniture.set_qvel(torch.zeros_like(qpos))


def _apply_objects(episode: Episode, handles: SceneHandles) -> None:
    unknown = set(episode.objects) - set(handles.pickables)
    if unknown:
        raise EpisodeError(f"{episode.id}: no object {sorted(unknown)} was loaded.")
    for index, (name, actor) in enumerate(handles.pickables.items()):
        _place(actor, episode.objects.get(name, parking_pose(index)))
    starts = {o.name: o.world_from_object for o in handles.spec.objects if o.dynamic}
    for name, actor in handles.loose.items():
        _place(actor, episode.loose.get(name, starts[name]))


def _place(actor: Actor, pose: Pose7) -> None:
    row = torch.tensor([pose], dtype=torch.float32, device=actor.device)
    actor.set_pose(Pose.create(row))
    zero = torch.zeros(3, device=actor.device)
    actor.set_linear_velocity(zero)
    actor.set_angular_velocity(zero)


def _apply_robot(episode: Episode, agent: HabFetch) -> None:
    qpos = agent.rest_qpos()[None]
    qpos[0, agent.base_index] = torch.tensor(episode.robot.base, device=agent.device)
    for name, value in zip(ARM_JOINTS, episode.robot.arm_qpos_rad, strict=True):
        qpos[0, agent.joint_index[name]] = value
    agent.robot.set_qpos(qpos)
    agent.robot.set_qvel(torch.zeros_like(qpos))
