"""Scene dataset files -> `SceneSpec`. The only place where y-up data become z-up."""

from __future__ import annotations

import logging
import math
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from hab_tasks.errors import DatasetError, UnknownNameError
from hab_tasks.geometry import IDENTITY, WORLD_FROM_HABITAT, Pose7, apply, compose, pose
from hab_tasks.scenes.dataset import SceneDataset, read_json
from hab_tasks.scenes.meshes import check_mesh, mesh_bounds
from hab_tasks.scenes.navmesh import NavmeshBounds, read_navmesh_bounds
from hab_tasks.scenes.spec import (
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
from hab_tasks.scenes.stage import shell
from hab_tasks.scenes.urdf import check_urdf
from hab_tasks.scenes.walls import inner_walls

logger = logging.getLogger(__name__)

HABITAT_UP: Vector = (0.0, 1.0, 0.0)
DEFAULT_FRICTION = 0.5
DEFAULT_BOUNDS: tuple[Vector, Vector] = ((-2.66, -0.05, -4.76), (4.60, 4.66, 8.17))
_said: set[str] = set()


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

    Args:
        dataset: Where it is from.
        scene_id: Which layout.
        changed: What its file is taken to hold instead.
    """
    file = dataset.scene_file(scene_id)
    data = read_json(file) if changed is None else changed
    with _fields_of(file):
        objects, missing = _objects(dataset, file, data)
        articulations = _articulations(dataset, file, data)
        stage = _stage(dataset, scene_id, data)
    if missing:
        absent = ", ".join(_absent_templates(dataset))
        _say_once(
            f"{dataset.source.root}: objects without files are skipped wherever they occur: "
            f"{absent}."
        )
    receptacles = [r for instance in objects for r in _placed_receptacles(instance)]
    for instance in articulations:
        receptacles.extend(_articulated_receptacles(instance))
    return SceneSpec(
        scene_id=scene_id,
        dataset=dataset.name,
        stage=stage,
        objects=tuple(objects),
        articulations=tuple(articulations),
        receptacles=tuple(receptacles),
        lights=_lights(dataset, data),
        missing=tuple(missing),
    )


@lru_cache(maxsize=1024)
def load_template(file: Path) -> ObjectTemplate | None:
    """Reads an object_config file; None when its mesh is absent.

    Raises:
        DatasetError: A file is damaged.
    """
    data = read_json(file)
    with _fields_of(file):
        visual = (file.parent / data["render_asset"]).resolve()
        if not visual.exists():
            return None
        check_mesh(visual)
        return _template(file, data, visual)


def _template(file: Path, data: dict[str, Any], visual: Path) -> ObjectTemplate:
    name = file.name.removesuffix(".object_config.json")
    up = _vector(data.get("up", HABITAT_UP))
    return ObjectTemplate(
        name=name,
        visual_file=visual,
        collision=(_collision(file, data, visual),),
        mass_kg=data.get("mass"),
        friction=float(data.get("friction_coefficient", DEFAULT_FRICTION)),
        up=up,
        receptacles=tuple(read_receptacles(data, name, up)),
        category=read_category(file),
    )


def read_category(file: Path) -> str:
    """Returns an object's semantic category, empty when neither its config nor a lexicon has it."""
    data = read_json(file)
    with _fields_of(file):
        stated = data.get("user_defined", {}).get("category")
        known = _lexicon(next((p for p in file.parents if p.name == "configs"), file.parent))
        return str(stated or known.get(data.get("semantic_id", -1), ""))


@lru_cache(maxsize=16)
def _lexicon(configs: Path) -> dict[int, str]:
    """Semantic id -> class name, from the lexicon of a dataset's folder ``configs``."""
    names = {}
    for file in sorted(configs.glob("ssd/*semantic_lexicon.json")):
        data = read_json(file)
        with _fields_of(file):
            names |= {int(entry["id"]): str(entry["name"]) for entry in data["classes"]}
    return names


def read_receptacles(data: dict[str, Any], body: str, up: Vector) -> list[Receptacle]:
    """Reads ``receptacle_aabb_*`` entries. `scale` holds HALF extents, sometimes negative."""
    found = []
    for key, entry in data.get("user_defined", {}).items():
        if not key.startswith("receptacle_aabb_"):
            continue
        link = entry.get("parent_link")
        found.append(
            Receptacle(
                name=entry.get("name", key),
                body=f"{body}/{link}" if link else body,
                body_from_box=_pose(entry["position"], entry.get("rotation", (1, 0, 0, 0))),
                half_size_m=_vector([abs(x) for x in entry["scale"]]),
                up=_vector(entry.get("up", up)),
            )
        )
    return found


def _collision(file: Path, data: dict[str, Any], visual: Path) -> CollisionSource:
    if data.get("collision_asset") and not data.get("use_bounding_box_for_collision"):
        asset = (file.parent / data["collision_asset"]).resolve()
        if asset.exists():
            check_mesh(asset)
            return CollisionSource(kind="convex_parts", file=asset)
        _say_once(f"{file}: its collision_asset is absent; its bounding box is used instead.")
    center, half = mesh_bounds(visual)
    return CollisionSource(kind="box", center_m=center, half_size_m=half)


def _objects(
    dataset: SceneDataset, file: Path, data: dict[str, Any]
) -> tuple[list[ObjectInstance], list[str]]:
    instances, missing, counts = [], [], Counter()
    for entry in data.get("object_instances", []):
        template_name = Path(entry["template_name"]).name.removesuffix(".object_config.json")
        if template_name not in dataset.object_files:
            error = UnknownNameError("object template", template_name, dataset.object_files)
            raise DatasetError(f"{file}: {error}")
        template = load_template(dataset.object_files[template_name])
        if template is None:
            missing.append(template_name)
            continue
        instances.append(
            ObjectInstance(
                name=f"{template_name}_:{counts[template_name]:04d}",
                template=template,
                world_from_object=_world_pose(entry),
                dynamic=entry.get("motion_type", "STATIC").upper() == "DYNAMIC",
                scale=float(entry.get("uniform_scale", 1.0)),
            )
        )
        counts[template_name] += 1
    return instances, sorted(set(missing))


def _absent_templates(dataset: SceneDataset) -> list[str]:
    return sorted(
        name for name, file in dataset.object_files.items() if load_template(file) is None
    )


def _articulations(
    dataset: SceneDataset, file: Path, data: dict[str, Any]
) -> list[ArticulationInstance]:
    instances, counts = [], Counter()
    for entry in data.get("articulated_object_instances", []):
        template = Path(entry["template_name"]).name
        if template not in dataset.urdf_files:
            error = UnknownNameError("articulated template", template, dataset.urdf_files)
            raise DatasetError(f"{file}: {error}")
        urdf = dataset.urdf_files[template]
        check_urdf(urdf)
        instances.append(
            ArticulationInstance(
                name=f"{template}_:{counts[template]:04d}",
                template=template,
                urdf_file=urdf,
                world_from_root=_world_pose(entry),
                scale=float(entry.get("uniform_scale", 1.0)),
            )
        )
        counts[template] += 1
    return instances


def _placed_receptacles(instance: ObjectInstance) -> list[Receptacle]:
    return [_scaled(r, instance.name, instance.scale) for r in instance.template.receptacles]


def _articulated_receptacles(instance: ArticulationInstance) -> list[Receptacle]:
    config = instance.urdf_file.with_suffix(".ao_config.json")
    if not config.exists():
        return []
    data = read_json(config)
    with _fields_of(config):
        entries = read_receptacles(data, instance.name, HABITAT_UP)
    return [_scaled(r, r.body, instance.scale) for r in entries]


def _scaled(receptacle: Receptacle, body: str, scale: float) -> Receptacle:
    position = tuple(scale * x for x in receptacle.body_from_box[:3])
    return Receptacle(
        name=receptacle.name,
        body=body,
        body_from_box=pose(position, receptacle.body_from_box[3:]),
        half_size_m=_vector([scale * x for x in receptacle.half_size_m]),
        up=receptacle.up,
    )


def _stage(dataset: SceneDataset, scene_id: str, data: dict[str, Any]) -> Stage:
    entry = data["stage_instance"]
    name = Path(entry["template_name"]).name.removesuffix(".stage_config.json")
    config = read_json(dataset.stage_files[name]) if name in dataset.stage_files else {}
    folder = dataset.source.root / "configs" / "stages"
    visual = (folder / config.get("render_asset", f"../../stages/{name}.glb")).resolve()
    asset = config.get("collision_asset")
    if visual.exists():
        check_mesh(visual)
    else:
        _say_once(
            f"{dataset.source.root}: stage meshes absent; floor and walls are boxes made from the "
            "navmesh files (stairs are wall as well)."
        )
    if visual.exists() and asset:
        file = (folder / asset).resolve()
        if not file.exists():
            raise DatasetError(f"{dataset.stage_files[name]}: no collision_asset {file}.")
        check_mesh(file)
        collision: tuple[CollisionSource, ...] = (CollisionSource(kind="convex_parts", file=file),)
    else:
        # Planning and the free floor need convex parts, which a scan's triangles are not.
        if visual.exists():
            _say_once(
                f"{dataset.source.root}: stage meshes without collision_asset collide as boxes."
            )
        collision = shell(_stage_bounds(dataset, scene_id, visual))
    return Stage(
        name=name,
        visual_file=visual if visual.exists() else None,
        collision=collision,
        world_from_stage=_world_pose(entry),
        friction=float(config.get("friction_coefficient", DEFAULT_FRICTION)),
    )


def _stage_bounds(dataset: SceneDataset, scene_id: str, visual: Path) -> NavmeshBounds:
    if visual.exists():
        (cx, cy, cz), (hx, hy, hz) = mesh_bounds(visual)
        return NavmeshBounds(low=(cx - hx, cy - hy, cz - hz), high=(cx + hx, cy + hy, cz + hz))
    navmesh = dataset.navmesh_file(scene_id)
    if navmesh is None:
        return NavmeshBounds(low=DEFAULT_BOUNDS[0], high=DEFAULT_BOUNDS[1])
    return read_navmesh_bounds(navmesh)


def _lights(dataset: SceneDataset, data: dict[str, Any]) -> tuple[PointLight, ...]:
    name = Path(data.get("default_lighting", "")).name.removesuffix(".lighting_config.json")
    if name not in dataset.lighting_files:
        return ()
    lights = []
    for entry in read_json(dataset.lighting_files[name]).get("lights", {}).values():
        intensity = float(entry.get("intensity", 1.0))
        # ReplicaCAD takes light away with negative lamps; the renderer here has no such thing.
        if entry.get("type", "point") != "point" or intensity <= 0:
            continue
        color = _vector([intensity * c for c in entry.get("color", (1, 1, 1))])
        position = _vector(apply(WORLD_FROM_HABITAT, entry["position"]))
        lights.append(PointLight(position_m=position, color=color))
    return tuple(lights)


def _world_pose(entry: dict[str, Any]) -> Pose7:
    local = IDENTITY
    if "translation" in entry or "rotation" in entry:
        local = _pose(entry.get("translation", (0, 0, 0)), entry.get("rotation", (1, 0, 0, 0)))
    return compose(WORLD_FROM_HABITAT, local)


def _pose(position: Any, wxyz: Any) -> Pose7:
    rotation = tuple(float(x) for x in wxyz)
    if len(rotation) != 4 or not math.hypot(*rotation) > 0 or not math.isfinite(sum(rotation)):
        raise ValueError(f"a rotation needs four numbers that are not all zero, found {wxyz}")
    return pose(_vector(position), rotation)


def _vector(values: Any) -> Vector:
    numbers = tuple(float(x) for x in values)
    if len(numbers) != 3 or not math.isfinite(sum(numbers)):
        raise ValueError(f"three numbers are needed, found {values}")
    return numbers


@contextmanager
def _fields_of(file: Path) -> Iterator[None]:
    """Names `file` when one of its fields is absent or of the wrong kind."""
    try:
        yield
    except KeyError as error:
        raise DatasetError(f"{file}: no field {error} in it.") from error
    except (TypeError, ValueError, AttributeError) as error:
        raise DatasetError(f"{file}: a field is malformed ({error}).") from error


def _say_once(message: str) -> None:
    if message not in _said:
        _said.add(message)
        logger.warning(message)
