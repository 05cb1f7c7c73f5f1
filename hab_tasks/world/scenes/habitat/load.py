"""Loads scene dataset files to `SceneSpec`; the only module that converts y-up data to z-up."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from hab_tasks.errors import DatasetError, UnknownNameError
from hab_tasks.geometry import IDENTITY, WORLD_FROM_HABITAT, Pose7, apply, compose, pose
from hab_tasks.io.cache import warn_once
from hab_tasks.world.scenes.fields import Fields, is_present, read_fields
from hab_tasks.world.scenes.habitat.dataset import SceneDataset
from hab_tasks.world.scenes.habitat.navmesh import NavmeshBounds, read_navmesh_bounds, shell
from hab_tasks.world.scenes.meshes import check_any_mesh, mesh_bounds
from hab_tasks.world.scenes.spec import (
    ArticulationInstance,
    CollisionSource,
    ObjectInstance,
    ObjectTemplate,
    PointLight,
    Receptacle,
    SceneSpec,
    Stage,
    Vector,
)
from hab_tasks.world.scenes.urdf import check_urdf, link_names
from hab_tasks.world.scenes.walls import inner_walls

HABITAT_UP: Vector = (0.0, 1.0, 0.0)
DEFAULT_FRICTION = 0.5
DEFAULT_BOUNDS: tuple[Vector, Vector] = ((-2.66, -0.05, -4.76), (4.60, 4.66, 8.17))

MOTIONS = ("STATIC", "DYNAMIC", "KINEMATIC")

NO_LIGHTS = ("", "no_lights")
"""Habitat's names for a layout without lamps."""

SAME_PLACE = 1e-3
"""Tolerance for equality of poses (metres and quaternions)."""

MOST_FURNITURE = 64
"""Maximum number of articulated pieces in a layout; ReplicaCAD has 6. With hundreds at one
position, a physics step takes minutes."""


def load_scene(dataset: SceneDataset, scene_id: str) -> SceneSpec:
    """Reads and checks one layout.

    Raises:
        UnknownNameError: The dataset has no such scene.
        DatasetError: A file it needs is absent, damaged or names an unknown template.
    """
    spec = read_scene(dataset, scene_id)
    if all(source.kind == "convex_parts" for source in spec.stage.collision):
        return spec
    walls = inner_walls(dataset, spec, partial(read_scene, dataset.source))
    return replace(spec, stage=replace(spec.stage, collision=spec.stage.collision + walls))


def read_scene(
    dataset: SceneDataset, scene_id: str, changed: dict[str, Any] | None = None
) -> SceneSpec:
    """Reads a layout; a stage without convex parts has only floor and outer walls.

    `changed` replaces the content of its file.
    """
    file = dataset.scene_file(scene_id)
    scene = read_fields(file) if changed is None else Fields(file, changed)
    objects, missing = _objects(dataset, scene)
    articulations = _articulations(dataset, scene)
    stage = _stage(dataset, scene_id, scene.part("stage_instance"))
    if missing:
        known = sorted(dataset.object_files.items())
        absent = ", ".join(name for name, file in known if load_template(file) is None)
        warn_once(
            f"{dataset.source.root}: objects without files are skipped wherever they occur: "
            f"{absent}."
        )
    placed = ((r, item) for item in objects for r in item.template.receptacles)
    receptacles = [_scaled(r, item.name, item.scale) for r, item in placed]
    for instance in articulations:
        receptacles.extend(articulated_receptacles(instance))
    return SceneSpec(
        scene_id=scene_id,
        dataset=dataset.name,
        stage=stage,
        objects=tuple(objects),
        articulations=tuple(articulations),
        receptacles=tuple(receptacles),
        lights=_lights(dataset, scene),
        missing=tuple(missing),
    )


@lru_cache(maxsize=1024)
def load_template(file: Path) -> ObjectTemplate | None:
    """Reads an object_config file; None when its mesh is absent.

    Raises:
        DatasetError: A file is damaged.
    """
    config = read_fields(file)
    visual = config.path("render_asset")
    if not is_present(visual):
        return None
    check_any_mesh(visual)
    name = file.name.removesuffix(".object_config.json")
    up = config.direction("up", HABITAT_UP)
    return ObjectTemplate(
        name=name,
        visual_file=visual,
        collision=(_collision(config, visual),),
        mass_kg=config.number("mass", above=0.0) if "mass" in config else None,
        friction=config.number("friction_coefficient", DEFAULT_FRICTION, least=0.0),
        up=up,
        receptacles=tuple(read_receptacles(config, name, up)),
        category=read_category(file),
    )


def read_category(file: Path) -> str:
    """Returns an object's semantic category, empty when neither its config nor a lexicon has it."""
    config = read_fields(file)
    stated = config.part("user_defined", optional=True).text("category", "")
    known = _lexicon(next((p for p in file.parents if p.name == "configs"), file.parent))
    return stated or known.get(config.whole("semantic_id", -1), "")


@lru_cache(maxsize=16)
def _lexicon(configs: Path) -> dict[int, str]:
    """Semantic id -> class name, from the lexicon of a dataset's folder ``configs``."""
    names = {}
    for file in sorted(configs.glob("ssd/*semantic_lexicon.json")):
        for entry in read_fields(file).parts("classes"):
            names[entry.whole("id")] = entry.text("name")
    return names


def read_receptacles(config: Fields, body: str, up: Vector) -> list[Receptacle]:
    """Reads ``receptacle_aabb_*`` entries. `scale` holds HALF extents, sometimes negative."""
    found = []
    user_defined = config.part("user_defined", optional=True)
    for key in user_defined.values:
        if not key.startswith("receptacle_aabb_"):
            continue
        entry = user_defined.part(key)
        half = entry.vector("scale")
        if 0.0 in half:
            raise entry.refused("scale", "3 numbers other than 0")
        link = entry.text("parent_link", "")
        found.append(
            Receptacle(
                name=entry.text("name", key),
                body=f"{body}/{link}" if link else body,
                body_from_box=pose(entry.vector("position"), entry.rotation("rotation")),
                half_size_m=(abs(half[0]), abs(half[1]), abs(half[2])),
                up=entry.direction("up", up),
            )
        )
    return found


def _collision(config: Fields, visual: Path) -> CollisionSource:
    as_box = config.flag("use_bounding_box_for_collision")
    if config.text("collision_asset", "") and not as_box:
        asset = config.path("collision_asset")
        if is_present(asset):
            check_any_mesh(asset)
            return CollisionSource(kind="convex_parts", file=asset)
        words = "its collision_asset is absent; its bounding box is used instead."
        warn_once(f"{config.file}: {words}")
    center, half = mesh_bounds(visual)
    return CollisionSource(kind="box", center_m=center, half_size_m=half)


def _objects(dataset: SceneDataset, scene: Fields) -> tuple[list[ObjectInstance], list[str]]:
    instances, missing, counts = [], [], Counter()
    for entry in scene.parts("object_instances", optional=True):
        name = _template_name(entry, ".object_config.json", dataset.object_files)
        template = load_template(dataset.object_files[name])
        if template is None:
            missing.append(name)
            continue
        instances.append(
            ObjectInstance(
                name=f"{name}_:{counts[name]:04d}",
                template=template,
                world_from_object=_world_pose(entry),
                dynamic=entry.choice("motion_type", "STATIC", MOTIONS) == "DYNAMIC",
                scale=entry.number("uniform_scale", 1.0, above=0.0),
            )
        )
        counts[name] += 1
    return instances, sorted(set(missing))


def _template_name(entry: Fields, suffix: str, known: Mapping[str, Path]) -> str:
    """Returns the template of an instance."""
    name = Path(entry.text("template_name")).name.removesuffix(suffix)
    if name not in known:
        error = UnknownNameError("template", name, known)
        raise DatasetError(f"{entry.file}: {entry.at('template_name')}: {error}")
    return name


def _articulations(dataset: SceneDataset, scene: Fields) -> list[ArticulationInstance]:
    instances, counts = [], Counter()
    entries = scene.parts("articulated_object_instances", optional=True)
    if len(entries) > MOST_FURNITURE:
        words = f"{len(entries)} articulated_object_instances; at most {MOST_FURNITURE} are built"
        raise DatasetError(f"{scene.file}: {words}.")
    for entry in entries:
        template = _template_name(entry, ".urdf", dataset.urdf_files)
        urdf = dataset.urdf_files[template]
        check_urdf(urdf)
        instances.append(
            ArticulationInstance(
                name=f"{template}_:{counts[template]:04d}",
                template=template,
                urdf_file=urdf,
                world_from_root=_world_pose(entry),
                scale=entry.number("uniform_scale", 1.0, above=0.0),
            )
        )
        counts[template] += 1
        _check_apart(entry, instances)
    return instances


def _check_apart(entry: Fields, instances: list[ArticulationInstance]) -> None:
    """Rejects a piece at the pose of another of its template: all parts would be in contact."""
    *others, last = instances
    for other in others:
        same = other.template == last.template and other.scale == last.scale
        if same and math.dist(other.world_from_root, last.world_from_root) < SAME_PLACE:
            words = f"{last.template} stands where another {last.template} stands"
            raise DatasetError(f"{entry.file}: {entry.location}: {words}.")


def articulated_receptacles(instance: ArticulationInstance) -> list[Receptacle]:
    """Returns the receptacles in furniture, from the ao_config beside its URDF."""
    config = instance.urdf_file.with_suffix(".ao_config.json")
    if not is_present(config):
        return []
    entries = read_receptacles(read_fields(config), instance.name, HABITAT_UP)
    links = [f"{instance.name}/{link}" for link in link_names(instance.urdf_file)]
    for receptacle in entries:
        if receptacle.body not in (instance.name, *links):
            error = UnknownNameError(f"link of {receptacle.name}", receptacle.body, links)
            raise DatasetError(f"{config}: {error}")
    return [_scaled(r, r.body, instance.scale) for r in entries]


def _scaled(receptacle: Receptacle, body: str, scale: float) -> Receptacle:
    position = tuple(scale * x for x in receptacle.body_from_box[:3])
    x, y, z = receptacle.half_size_m
    return Receptacle(
        name=receptacle.name,
        body=body,
        body_from_box=pose(position, receptacle.body_from_box[3:]),
        half_size_m=(scale * x, scale * y, scale * z),
        up=receptacle.up,
    )


def _stage(dataset: SceneDataset, scene_id: str, entry: Fields) -> Stage:
    name = Path(entry.text("template_name")).name.removesuffix(".stage_config.json")
    # Without a configuration, the mesh of that name.
    file = dataset.source.root / "configs" / "stages" / f"{name}.stage_config.json"
    config = Fields(file, {})
    if name in dataset.stage_files:
        config = replace(read_fields(dataset.stage_files[name]), file=file)
    visual = config.path("render_asset", f"../../stages/{name}.glb")
    if is_present(visual):
        check_any_mesh(visual)
    else:
        warn_once(
            f"{dataset.source.root}: stage meshes absent; floor and walls are boxes made from the "
            "navmesh files (stairs are wall as well)."
        )
    return Stage(
        name=name,
        visual_file=visual if is_present(visual) else None,
        collision=_stage_collision(dataset, scene_id, config, visual),
        world_from_stage=_world_pose(entry),
        friction=config.number("friction_coefficient", DEFAULT_FRICTION, least=0.0),
    )


def _stage_collision(
    dataset: SceneDataset, scene_id: str, config: Fields, visual: Path
) -> tuple[CollisionSource, ...]:
    if is_present(visual) and config.text("collision_asset", ""):
        file = config.path("collision_asset")
        if not is_present(file):
            raise DatasetError(f"{config.file}: no collision_asset {file}.")
        check_any_mesh(file)
        return (CollisionSource(kind="convex_parts", file=file),)
    # Planning and the free floor need convex parts, which a scan's triangles are not.
    if is_present(visual):
        warn_once(f"{dataset.source.root}: stage meshes without collision_asset collide as boxes.")
    return shell(_stage_bounds(dataset, scene_id, visual))


def _stage_bounds(dataset: SceneDataset, scene_id: str, visual: Path) -> NavmeshBounds:
    if visual.exists():
        (cx, cy, cz), (hx, hy, hz) = mesh_bounds(visual)
        return NavmeshBounds(low=(cx - hx, cy - hy, cz - hz), high=(cx + hx, cy + hy, cz + hz))
    navmesh = dataset.navmesh_file(scene_id)
    if navmesh is None:
        return NavmeshBounds(low=DEFAULT_BOUNDS[0], high=DEFAULT_BOUNDS[1])
    return read_navmesh_bounds(navmesh)


def _lights(dataset: SceneDataset, scene: Fields) -> tuple[PointLight, ...]:
    name = Path(scene.text("default_lighting", "")).name.removesuffix(".lighting_config.json")
    if name in NO_LIGHTS:
        return ()
    if name not in dataset.lighting_files:
        error = UnknownNameError("lighting", name, dataset.lighting_files)
        if dataset.lighting_files:
            raise DatasetError(f"{scene.file}: default_lighting: {error}")
        warn_once(f"{dataset.source.root}: no lighting_config files; layouts have no lamps.")
        return ()
    return read_lamps(dataset.lighting_files[name])


def _world_pose(entry: Fields) -> Pose7:
    local = IDENTITY
    if "translation" in entry or "rotation" in entry:
        local = pose(entry.vector("translation", (0.0, 0.0, 0.0)), entry.rotation("rotation"))
    return compose(WORLD_FROM_HABITAT, local)


@lru_cache(maxsize=64)
def read_lamps(file: Path) -> tuple[PointLight, ...]:
    """Returns the point lights that shine.

    Raises:
        DatasetError: The file is damaged.
    """
    config = read_fields(file).part("lights", optional=True)
    lamps = []
    for key in config.values:
        lamp = config.part(key)
        intensity = lamp.number("intensity", 1.0)
        # ReplicaCAD takes light away with negative lamps; the renderer here has no such thing.
        if lamp.text("type", "point") != "point" or intensity <= 0:
            continue
        x, y, z = map(float, apply(WORLD_FROM_HABITAT, np.array(lamp.vector("position"))))
        red, green, blue = lamp.vector("color", (1.0, 1.0, 1.0))
        color = (intensity * red, intensity * green, intensity * blue)
        lamps.append(PointLight(position_m=(x, y, z), color=color))
    return tuple(lamps)
