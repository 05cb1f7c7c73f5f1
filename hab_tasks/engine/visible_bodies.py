"""The bodies that a renderer would draw, for what works without one: ray casting, recordings."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

from hab_tasks.engine.episode_simulation import EpisodeSimulation
from hab_tasks.robots.mobile_manipulator import MobileManipulator
from hab_tasks.simulator import sapien_object
from hab_tasks.world.raycast.scene import RayBody
from hab_tasks.world.scenes.visuals import (
    furniture_visuals,
    stage_visuals,
    template_visuals,
    urdf_visuals,
)

ROBOT = "robot"
"""Prefix of the names of the robot's links."""


def visible_bodies(
    simulation: EpisodeSimulation, agent: MobileManipulator, hidden: Collection[str] = ()
) -> Iterator[RayBody]:
    """Yields the bodies of the active layout and the robot, without its `hidden` links."""
    active = simulation.scene_bodies
    spec, templates = active.spec, simulation.source.objects
    stage: Any = sapien_object(active.stage)
    yield RayBody(name="stage", visuals=stage_visuals(spec.stage), entity=stage, moves=False)
    for item in spec.objects:
        actor = (active.loose if item.dynamic else active.static)[item.name]
        visuals, entity = template_visuals(item.template, item.scale), sapien_object(actor)
        yield RayBody(name=item.name, visuals=visuals, entity=entity, moves=item.dynamic)
    for name, actor in active.pickables.items():
        visuals = template_visuals(templates[name.rsplit("_:", 1)[0]], 1.0)
        yield RayBody(name=name, visuals=visuals, entity=sapien_object(actor))
    for furniture in spec.articulations:
        of_link = furniture_visuals(furniture.urdf_file, furniture.scale)
        for link in active.articulations[furniture.name].links:
            name, entity = f"{furniture.name}/{link.name}", sapien_object(link).entity
            yield RayBody(name=name, visuals=of_link[link.name], entity=entity)
    of_link = urdf_visuals(agent.urdf(visuals=True))
    for link in agent.robot.links:
        if link.name not in hidden:
            name, entity = f"{ROBOT}/{link.name}", sapien_object(link).entity
            yield RayBody(name=name, visuals=of_link[link.name], entity=entity)
