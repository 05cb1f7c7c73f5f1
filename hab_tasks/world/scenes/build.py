"""Builds actors and articulations from their descriptions; the only module that creates them.

Works with and without a renderer: visuals, materials and lights are created only if the scene can
render.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import sapien
from mani_skill.envs.scene import ManiSkillScene
from mani_skill.utils.structs import Actor, Articulation
from sapien.physx import PhysxMaterial

from hab_tasks.errors import DatasetError
from hab_tasks.geometry import BOX_CORNERS, Pose7, apply
from hab_tasks.simulator import rigid_body, sapien_object
from hab_tasks.world.scenes.meshes import parts_volume
from hab_tasks.world.scenes.physics import (
    FLOOR_BIT,
    FRONT,
    FURNITURE_BIT,
    MOVING,
    PASSIVE,
    STATIC,
    brake,
    set_groups,
)
from hab_tasks.world.scenes.spec import (
    ArticulationInstance,
    CollisionSource,
    ObjectTemplate,
    PointLight,
    Stage,
)
from hab_tasks.world.scenes.urdf import articulation_builder, joint_frictions, sapien_urdf
from hab_tasks.world.scenes.visuals import visual_file

FLAT_HEIGHT_M = 0.05
"""Maximum height of flat bodies (floor, rugs, mats), which do not collide with the robot's base."""

PARKING_Z_M = -5.0
PARKING_SPACING_M = 0.5

WALL_COLOR = (0.86, 0.84, 0.80, 1.0)
FLOOR_COLOR = (0.55, 0.45, 0.36, 1.0)


def parking_pose(index: int) -> Pose7:
    """Returns where object number `index` is built, before an episode places it."""
    row, column = divmod(index, 8)
    x, y = column * PARKING_SPACING_M, row * PARKING_SPACING_M
    return (x, y, PARKING_Z_M + 0.2, 1.0, 0.0, 0.0, 0.0)


class BodyBuilder:
    """Builds named bodies in one scene."""

    def __init__(self, scene: ManiSkillScene, friction: float = 1.0) -> None:
        """`friction` is a factor of the friction coefficients of dynamic objects."""
        self.scene, self._friction = scene, friction
        self.visuals = scene.can_render()

    def stage(self, stage: Stage) -> Actor:
        """Builds floor and walls."""
        builder = self._new(stage.world_from_stage)
        self._collide(builder, stage.collision, _material(stage.friction), 1000.0)
        if self.visuals and stage.visual_file is not None:
            builder.add_visual_from_file(str(stage.visual_file))
        elif self.visuals:
            for source in stage.collision:
                flat = source.half_size_m[1] < 0.1
                color = FLOOR_COLOR if flat else WALL_COLOR
                material = sapien.render.RenderMaterial(base_color=list(color))
                material.roughness = 0.8
                builder.add_box_visual(_at(source), list(source.half_size_m), material)
        built = builder.build_static(f"stage-{stage.name}")
        _check_shapes(built, stage.collision)
        return mark_flat(built)

    def static(self, name: str, template: ObjectTemplate, pose: Pose7, scale: float) -> Actor:
        """Builds a static object."""
        builder = self._new(pose)
        self._collide(builder, template.collision, _material(template.friction), 1000.0, scale)
        self._see(builder, template, scale)
        built = builder.build_static(name)
        _check_shapes(built, template.collision)
        return mark_flat(built)

    def dynamic(self, name: str, template: ObjectTemplate, pose: Pose7, scale: float) -> Actor:
        """Builds a dynamic object with its stated mass."""
        builder = self._new(pose)
        volume_m3 = scale**3 * sum(_volume(source) for source in template.collision)
        mass_kg = template.mass_kg if template.mass_kg is not None else 500.0 * volume_m3
        density = mass_kg / max(volume_m3, 1e-9)
        material = _material(self._friction * template.friction)
        self._collide(builder, template.collision, material, density, scale)
        self._see(builder, template, scale)
        actor = builder.build_dynamic(name)
        _check_shapes(actor, template.collision)
        set_groups(rigid_body(actor), MOVING)
        # Cooked hulls are slightly smaller than the mesh, so the mass is set explicitly.
        rigid_body(actor).mass = mass_kg
        return actor

    def articulation(self, furniture: ArticulationInstance, group: int) -> Articulation:
        """Builds articulated furniture; `group` disables collisions between its links."""
        text = sapien_urdf(furniture.urdf_file, self.visuals, furniture.bars)
        with articulation_builder(
            self.scene, text, furniture.name, scale=furniture.scale, many_parts=True
        ) as builder:
            builder.initial_pose = to_sapien(furniture.world_from_root)
            for link in builder.link_builders:
                link.collision_groups = [*FRONT, FURNITURE_BIT, group]
            built = builder.build()
            stated = {link.name: len(link.collision_records) for link in builder.link_builders}
        for link in built.links:
            if len(sapien_object(link).collision_shapes) < stated[link.name]:
                words = f"link {link.name!r} has collision meshes that the engine cannot read"
                raise DatasetError(f"{furniture.urdf_file}: {words}.")
        moving = {j.child_link.name for j in built.active_joints if j.child_link is not None}
        for link in built.links:
            # Slides are horizontal and hinges vertical, so gravity would only load them.
            link.disable_gravity = True
            set_groups(sapien_object(link), FRONT if link.name in moving else PASSIVE)
        brake(built, joint_frictions(furniture.urdf_file))
        return built

    def _new(self, pose: Pose7) -> Any:
        builder: Any = self.scene.create_actor_builder()
        builder.initial_pose = to_sapien(pose)
        return builder

    def _see(self, builder: Any, template: ObjectTemplate, scale: float) -> None:
        file = visual_file(template) if self.visuals else None
        if file is not None:
            builder.add_visual_from_file(str(file), scale=[scale] * 3)

    def _collide(
        self,
        builder: Any,
        sources: Iterable[CollisionSource],
        material: PhysxMaterial,
        density: float,
        scale: float = 1.0,
    ) -> None:
        for source in sources:
            common = {"material": material, "density": density}
            if source.kind == "box":
                half = [scale * x for x in source.half_size_m]
                builder.add_box_collision(_at(source, scale), half, **common)
            elif source.file is None or not source.file.exists():
                # SAPIEN would only log it and build a body without collisions.
                raise DatasetError(f"{source.file}: gone since the dataset was read.")
            else:
                builder.add_multiple_convex_collisions_from_file(
                    str(source.file), scale=[scale] * 3, **common
                )


def _check_shapes(actor: Actor, sources: tuple[CollisionSource, ...]) -> None:
    """Raises DatasetError for a body without collision shapes; the engine only logs it."""
    if len(rigid_body(actor).collision_shapes) < len(sources):
        files = ", ".join(str(source.file) for source in sources if source.file is not None)
        raise DatasetError(f"{files}: the engine finds no shape in it to collide with.")


def mark_flat(actor: Actor) -> Actor:
    """Sets a static actor's collision groups by its height: flat bodies ignore the base."""
    body = rigid_body(actor)
    for shape in body.collision_shapes:
        flat = _top_m(body, shape) < FLAT_HEIGHT_M
        shape.set_collision_groups([*STATIC, FLOOR_BIT if flat else 0, 0])
    return actor


def _top_m(body: sapien.physx.PhysxRigidBaseComponent, shape: Any) -> float:
    """Height [m] of a shape's highest point in the world."""
    if hasattr(shape, "half_size"):
        points = BOX_CORNERS * np.asarray(shape.half_size)
    else:
        points = np.asarray(shape.vertices) * np.asarray(shape.scale)
    world = body.entity.pose * shape.local_pose
    world_from_shape: Any = (*map(float, world.p), *map(float, world.q))
    return float(apply(world_from_shape, points)[:, 2].max())


def _volume(source: CollisionSource) -> float:
    if source.kind == "box":
        return 8.0 * float(np.prod(source.half_size_m))
    assert source.file is not None
    return parts_volume(source.file)


def _material(friction: float) -> PhysxMaterial:
    return PhysxMaterial(static_friction=friction, dynamic_friction=friction, restitution=0.0)


def to_sapien(pose: Pose7) -> sapien.Pose:
    """Returns a pose as a SAPIEN pose."""
    return sapien.Pose(list(pose[:3]), list(pose[3:]))


def _at(source: CollisionSource, scale: float = 1.0) -> sapien.Pose:
    return sapien.Pose([scale * x for x in source.center_m])


MAX_LIGHTS = 12


class LayoutLights:
    """Lighting of the scene: ambient light, a soft sky, and the layout's lamps."""

    def __init__(self, scene: ManiSkillScene, brightness: float = 1.0) -> None:
        """Adds the lights shared by all layouts, `brightness` times as bright as usual."""
        scene.set_ambient_light([brightness * 0.35] * 3)
        scene.add_directional_light([0.3, 0.5, -1.0], [brightness * c for c in (0.9, 0.9, 0.85)])
        self._scene, self._brightness = scene, brightness
        self._lamps: list[sapien.Entity] = []
        self._shown: tuple[PointLight, ...] = ()

    def show(self, lights: tuple[PointLight, ...]) -> None:
        """Replaces the lamps by these, at most `MAX_LIGHTS`."""
        if lights == self._shown:
            return
        for lamp in self._lamps:
            lamp.remove_from_scene()
        self._lamps = [
            self._scene.add_point_light(
                list(light.position_m), [self._brightness * c for c in light.color]
            ).entity
            for light in lights[:MAX_LIGHTS]
        ]
        self._shown = lights
