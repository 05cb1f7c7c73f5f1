"""Writes an episode's start state to one row of the simulation."""

from __future__ import annotations

from typing import Any

import sapien
import torch
from mani_skill.utils.structs import Actor
from mani_skill.utils.structs.pose import Pose

from hab_tasks.episodes.schema import Episode
from hab_tasks.geometry import Pose7
from hab_tasks.robots.mobile_manipulator import MobileManipulator
from hab_tasks.robots.robot import ROBOT
from hab_tasks.scenes.build import parking_pose
from hab_tasks.scenes.scene_bodies import SceneBodies
from hab_tasks.simulator import rigid_body, sapien_object


def apply_episode(
    episode: Episode,
    row: int,
    scene_bodies: SceneBodies,
    agent: MobileManipulator,
    in_place: frozenset[str] = frozenset(),
) -> None:
    """Sets furniture, objects and robot in `row` to the start state, at rest.

    Args:
        episode: The episode, already checked against the layout.
        row: The row of the simulation; `scene_bodies` must have been built there.
        scene_bodies: The layout of `episode.scene_id`.
        agent: The robot.
        in_place: Loose objects that are already at their start poses.
    """
    scene = agent.scene
    mask = scene._reset_mask
    scene._reset_mask = torch.zeros_like(mask)
    scene._reset_mask[row] = True
    try:
        _apply_joints(episode, scene_bodies)
        _apply_objects(episode, row, scene_bodies, in_place)
        _apply_robot(episode, agent)
    finally:
        scene._reset_mask = mask


def _apply_joints(episode: Episode, scene_bodies: SceneBodies) -> None:
    for name, furniture in scene_bodies.articulations.items():
        index = {joint.name: i for i, joint in enumerate(furniture.active_joints)}
        qpos = torch.zeros(1, len(index), device=furniture.device)
        for joint, value in episode.joints.get(name, {}).items():
            qpos[0, index[joint]] = value
        furniture.set_qpos(qpos)
        furniture.set_qvel(torch.zeros_like(qpos))


def _apply_objects(
    episode: Episode, row: int, scene_bodies: SceneBodies, in_place: frozenset[str]
) -> None:
    for index, (name, actor) in enumerate(scene_bodies.pickables.items()):
        _place(actor, row, episode.objects.get(name, parking_pose(index)))
        _show(actor, row, name in episode.objects)
    starts = {o.name: o.world_from_object for o in scene_bodies.spec.objects if o.dynamic}
    for name, actor in scene_bodies.loose.items():
        if name not in in_place:
            _place(actor, row, episode.loose.get(name, starts[name]))


def _place(actor: Actor, row: int, pose: Pose7) -> None:
    if actor.scene.gpu_sim_enabled:
        actor.set_pose(Pose.create(torch.tensor([pose], device=actor.device)))
        zero = torch.zeros(3, device=actor.device)
        actor.set_linear_velocity(zero)
        actor.set_angular_velocity(zero)
        return
    body: Any = rigid_body(actor, row)
    body.entity.pose = sapien.Pose(list(pose[:3]), list(pose[3:]))
    if not body.kinematic:
        body.linear_velocity = body.angular_velocity = (0.0, 0.0, 0.0)


def _show(actor: Actor, row: int, visible: bool) -> None:
    """Hides parked objects from the renderer, which would not cull them."""
    component: Any = sapien_object(actor, row).find_component_by_type(
        sapien.render.RenderBodyComponent
    )
    if component is not None:
        component.visibility = 1.0 if visible else 0.0


def _apply_robot(episode: Episode, agent: MobileManipulator) -> None:
    qpos = agent.rest_qpos()[None]
    qpos[0, agent.base_index] = torch.tensor(episode.robot.base, device=agent.device)
    for name, value in zip(ROBOT.arm_joints, episode.robot.arm_qpos_rad, strict=True):
        qpos[0, agent.joint_index[name]] = value
    agent.robot.set_qpos(qpos)
    agent.robot.set_qvel(torch.zeros_like(qpos))
