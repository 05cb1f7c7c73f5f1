"""Pool of bodies that are built once and reused by all layouts (S B.1: load once, then instance).

Layouts of one dataset share most of their furniture. A `BodyPool` builds each piece when a layout
first needs it, and keeps it. To activate a layout, it adds the layout's bodies to the scene at
their poses and removes all others.

The engine keeps state of earlier bodies in a scene (the order of contacts). For bitwise
reproducible runs, start from a new simulation.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import sapien
import torch
from mani_skill.envs.scene import ManiSkillScene
from mani_skill.utils.structs import Actor, Articulation
from sapien import physx
from transforms3d.quaternions import quat2mat

from hab_tasks.errors import EpisodeError
from hab_tasks.geometry import Pose7
from hab_tasks.privileged import Array, CollisionBody, CollisionShape, ShapeKind
from hab_tasks.simulator import rigid_body, sapien_object, use_settings
from hab_tasks.world.scenes.build import BodyBuilder, mark_flat, parking_pose, to_sapien
from hab_tasks.world.scenes.spec import ArticulationInstance, ObjectTemplate, SceneSpec

MOST_KEPT = 2000
"""Maximum number of bodies kept for a new simulation."""

Body = Actor | Articulation
Key = tuple[object, ...]


@dataclass(kw_only=True)
class SceneBodies:
    """Active bodies of a pool by name; `loose` and `static` ones belong to the layout."""

    spec: SceneSpec
    stage: Actor | None = None
    static: dict[str, Actor] = field(default_factory=dict)
    loose: dict[str, Actor] = field(default_factory=dict)
    articulations: dict[str, Articulation] = field(default_factory=dict)
    pickables: dict[str, Actor] = field(default_factory=dict)

    @property
    def movable(self) -> dict[str, Actor]:
        """All graspable objects: pickables first, then the layout's loose objects."""
        return {**self.pickables, **self.loose}


class BodyPool:
    """Bodies built so far in one scene, and `scene_bodies`, those of the active layout."""

    scene_bodies: SceneBodies

    def __init__(
        self,
        scene: ManiSkillScene,
        templates: dict[str, ObjectTemplate],
        read: dict[Hashable, CollisionBody] | None = None,
        friction: float = 1.0,
    ) -> None:
        """Creates an empty pool of bodies in `scene`.

        `read` has collision bodies of earlier pools of the same dataset and objects; `friction` is
        a factor of the friction coefficients of movable objects.
        """
        self._scene, self._templates = scene, templates
        self._builder = BodyBuilder(scene, friction)
        self._built: dict[Key, Body] = {}
        # A link has a weak reference to its entity; the scene or this keeps it alive.
        self._entities: dict[Key, list[sapien.Entity]] = {}
        self._pose: dict[Key, Pose7] = {}
        self._shown: dict[Key, Body] = {}
        self._read: dict[Hashable, CollisionBody] = {} if read is None else read

    def show(self, spec: SceneSpec, objects: Iterable[str]) -> SceneBodies:
        """Activates a layout with movable objects; removes all other bodies from the scene.

        Raises:
            EpisodeError: An object (``template_:NNNN``) of a template that was not loaded.
        """
        self._clear()
        scene_bodies = self.scene_bodies = SceneBodies(spec=spec)
        scene_bodies.stage = self._stage(spec)
        for item in spec.objects:
            shown = self._loose if item.dynamic else self._static
            group = scene_bodies.loose if item.dynamic else scene_bodies.static
            group[item.name] = shown(item.name, item.template, item.world_from_object, item.scale)
        for furniture in spec.articulations:
            scene_bodies.articulations[furniture.name] = self._furniture(furniture)
        for index, instance in enumerate(objects):
            name = instance.rsplit("_:", 1)[0]
            if name not in self._templates:
                raise EpisodeError(f"no object {name!r} was loaded: {sorted(self._templates)}.")
            template = self._templates[name]
            scene_bodies.pickables[instance] = self._loose(
                instance, template, parking_pose(index), 1.0
            )
        return scene_bodies

    def leave(self) -> None:
        """Empties the scene before it gets a new simulation.

        Kept bodies behave in it as if built anew: loose objects are dropped and joints set to zero,
        as the engine keeps their state outside the simulation.
        """
        for built in self._shown.values():
            if isinstance(built, Articulation):
                built.set_qpos(torch.zeros_like(built.get_qpos()))
                built.set_qvel(torch.zeros_like(built.get_qpos()))
        self._clear()
        full = len(self._built) > MOST_KEPT
        for key in [key for key in self._built if full or key[0] == "loose"]:
            del self._built[key], self._entities[key], self._pose[key]

    def _clear(self) -> None:
        before, self._shown = self._shown, {}
        self._hide(before)

    def bodies(self) -> tuple[CollisionBody, ...]:
        """Returns the collision bodies of the active layout; each body is read once."""
        found = []
        named = {key[0] if key[0] == "stage" else key[1]: key for key in self._shown}
        for name, group, component in components(self.scene_bodies):
            owner = name.rpartition("/")[0] if group == "furniture" else name
            key = (named[owner], name)
            if key not in self._read:
                self._read[key] = read_body(name, group, component)
            found.append(self._read[key])
        return tuple(found)

    def _stage(self, spec: SceneSpec) -> Actor:
        stage = spec.stage
        key = ("stage", stage.name, stage.collision)
        built: Any = self._take(key, lambda: self._builder.stage(stage))
        self._put(key, built, stage.world_from_stage)
        return built

    def _static(self, name: str, template: ObjectTemplate, pose: Pose7, scale: float) -> Actor:
        key = ("static", name, template.name, scale)
        built: Any = self._take(key, lambda: self._builder.static(name, template, pose, scale))
        before = self._put(key, built, pose)
        if before is not None and not _as_high(before, pose):
            mark_flat(built)
        return built

    def _furniture(self, furniture: ArticulationInstance) -> Articulation:
        key = ("furniture", furniture.name, furniture.urdf_file, furniture.scale, furniture.bars)
        number = len(self._built) + 1
        built: Any = self._take(key, lambda: self._builder.articulation(furniture, number))
        self._put(key, built, furniture.world_from_root)
        return built

    def _loose(self, name: str, template: ObjectTemplate, pose: Pose7, scale: float) -> Actor:
        key = ("loose", name, template.name, scale)
        built: Any = self._take(key, lambda: self._builder.dynamic(name, template, pose, scale))
        self._put(key, built, pose)
        return built

    def _take(self, key: Key, build: Callable[[], Body]) -> Body:
        """Returns the body of a key: builds a new one, or adds a kept one to the scene again."""
        if key in self._built:
            built = self._built[key]
            for entity in self._entities[key]:
                self._scene.sub_scenes[0].add_entity(entity)
            self._listed(built)[built.name] = built
            self._scene.add_to_state_dict_registry(built)
        else:
            use_settings(self._scene.sim_config)
            built = self._built[key] = build()
            self._entities[key] = _entities(built)
        self._shown[key] = built
        return built

    def _put(self, key: Key, built: Body, pose: Pose7) -> Pose7 | None:
        """Moves a body to its pose; returns the previous pose, None if unchanged."""
        before, self._pose[key] = self._pose.get(key), pose
        if before is None:
            return None  # a new body is at its pose
        if before == pose and (_is_static(built) or isinstance(built, Articulation)):
            return None
        if isinstance(built, Articulation):
            sapien_object(built).set_root_pose(to_sapien(pose))
        else:
            sapien_object(built).pose = to_sapien(pose)
        return before

    def _hide(self, shown: dict[Key, Body]) -> None:
        for key, built in shown.items():
            for entity in self._entities[key]:
                entity.remove_from_scene()
            # Its name is free for what stands for it in another layout: a fixed one, another size.
            del self._listed(built)[built.name]
            self._scene.remove_from_state_dict_registry(built)

    def _listed(self, built: Body) -> dict[str, Any]:
        """Returns the scene's dict that a body belongs to."""
        listed: Any = self._scene
        return listed.articulations if isinstance(built, Articulation) else listed.actors


def _as_high(before: Pose7, after: Pose7) -> bool:
    """Whether all points of a body have the same height in both poses."""
    if before[2:] == after[2:]:
        return True
    heights = [(pose[2], *quat2mat(pose[3:])[2]) for pose in (before, after)]
    return np.allclose(*heights, atol=1e-6)


def _entities(built: Body) -> list[sapien.Entity]:
    if isinstance(built, Articulation):
        return [sapien_object(link).entity for link in built.links]
    return [sapien_object(built)]


def _is_static(built: Body) -> bool:
    return isinstance(built, Actor) and built.px_body_type == "static"


_NONE = np.zeros((0, 3))
_NO_FACES = np.zeros((0, 3), dtype=np.int64)


def matrix(pose: sapien.Pose) -> Array:
    """Returns a SAPIEN pose as a (4, 4) float64 matrix."""
    return pose.to_transformation_matrix().astype(np.float64)


def read_body(name: str, group: Any, component: Any) -> CollisionBody:
    """Reads the shapes of a rigid body component (first row's copy)."""
    shapes = tuple(_read_shape(shape) for shape in component.collision_shapes)
    return CollisionBody(name=name, group=group, shapes=shapes)


def components(scene_bodies: SceneBodies) -> Iterable[tuple[str, str, Any]]:
    """Yields (body name, group, component) of all bodies in the first row."""
    if scene_bodies.stage is not None:
        yield "stage", "stage", rigid_body(scene_bodies.stage)
    for name, actor in scene_bodies.static.items():
        yield name, "static", rigid_body(actor)
    for name, furniture in scene_bodies.articulations.items():
        for link in furniture.links:
            yield f"{name}/{link.name}", "furniture", sapien_object(link)
    for name, actor in scene_bodies.movable.items():
        yield name, "object", rigid_body(actor)


def _read_shape(shape: Any) -> CollisionShape:
    kind: ShapeKind = "convex"
    half, vertices, faces = np.zeros(3), _NONE, _NO_FACES
    if isinstance(shape, physx.PhysxCollisionShapeBox):
        kind, half = "box", np.asarray(shape.half_size, dtype=float)
    elif isinstance(shape, physx.PhysxCollisionShapeSphere):
        kind, half = "sphere", np.array([shape.radius, 0.0, 0.0])
    elif isinstance(shape, physx.PhysxCollisionShapeCapsule):
        kind, half = "capsule", np.array([shape.radius, shape.half_length, 0.0])
    elif isinstance(shape, physx.PhysxCollisionShapeCylinder):
        kind, half = "cylinder", np.array([shape.radius, shape.half_length, 0.0])
    elif isinstance(shape, physx.PhysxCollisionShapePlane):
        kind = "plane"
    else:
        vertices = np.asarray(shape.vertices, dtype=float) * np.asarray(shape.scale, dtype=float)
        faces = np.asarray(shape.triangles, dtype=np.int64).reshape(-1, 3)
    return CollisionShape(
        kind=kind,
        body_from_shape=matrix(shape.local_pose),
        half_size_m=half,
        vertices_m=vertices,
        faces=faces,
    )
