"""Writes a dataset in Habitat's scene dataset format.

The output is reproducible byte for byte: numbers are rounded well above floating-point noise, keys
are sorted, and the exporter's version stamp is dropped.
"""

import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from trimesh.exchange.gltf import export_glb
from trimesh.visual import TextureVisuals

from hab_authoring.apartment import materials
from hab_authoring.apartment.model import (
    Array,
    Articulation,
    Box,
    Convex,
    Dataset,
    Joint,
    Light,
    Link,
    ObjectModel,
    Part,
    Placement,
    Receptacle,
    SceneModel,
    StageModel,
)

POSITION_DIGITS, SOLID_DIGITS, NORMAL_DIGITS, UV_DIGITS, JSON_DIGITS = 5, 7, 3, 4, 6
SEMANTICS = "apartment_ssd_map"
# Their root joint turns the body forward by a right angle; the instance turns it back.
TURNED_BACK = {"kitchenCupboard_01", "chestOfDrawers_01"}
FRICTION = {"prismatic": 4.0, "revolute": 0.8}
"""Joint friction by kind, as of real furniture: N for rails, N m for hinges."""
Json = dict[str, Any]


def write_dataset(dataset: Dataset, name: str, out: Path) -> None:
    """Write all files of a dataset below `out`, which must not hold any of them."""
    for stage in dataset.stages:
        _write_stage(stage, out)
    for item in dataset.objects:
        _write_object(item, out)
    for articulation in dataset.articulations:
        _write_articulation(articulation, out)
    for key, lights in sorted(dataset.lightings.items()):
        _write_json(out / "configs/lighting" / f"{key}.lighting_config.json", _lighting(lights))
    for scene in dataset.scenes:
        _write_json(out / "configs/scenes" / f"{scene.name}.scene_instance.json", _scene(scene))
    words = f"configs/ssd/{name}_semantic_lexicon.json"
    _write_json(out / words, materials.lexicon({item.category for item in dataset.objects}))
    _write_json(out / f"{name}.scene_dataset_config.json", _dataset_config(words))


def _write_stage(stage: StageModel, out: Path) -> None:
    write_parts(stage.parts, out / "stages" / f"{stage.name}.glb")
    write_solids(stage.solids, out / "stages/convex" / f"{stage.name}_cv_decomp.glb")
    config: Json = {
        "render_asset": f"../../stages/{stage.name}.glb",
        "collision_asset": f"../../stages/convex/{stage.name}_cv_decomp.glb",
        "up": [0, 1, 0],
        "front": [0, 0, -1],
        "requires_lighting": True,
        "margin": 0.01,
        "friction_coefficient": 0.8,
        "restitution_coefficient": 0.0,
    }
    _write_json(out / "configs/stages" / f"{stage.name}.stage_config.json", config)


def _write_object(item: ObjectModel, out: Path) -> None:
    write_parts(item.parts, out / "objects" / f"{item.name}.glb")
    write_solids(item.solids, out / "objects/convex" / f"{item.name}_cv_decomp.glb")
    boxes = {r.name: _receptacle(r, item.name) for r in item.receptacles}
    config: Json = {
        "render_asset": f"../../objects/{item.name}.glb",
        "collision_asset": f"../../objects/convex/{item.name}_cv_decomp.glb",
        "mass": item.mass_kg,
        "COM": [0, 0, 0],
        "friction_coefficient": item.friction,
        "join_collision_meshes": False,
        "semantic_id": materials.CLASSES.get(item.category, 0),
        "user_defined": {"category": item.category} | boxes,
    }
    _write_json(out / "configs/objects" / f"{item.name}.object_config.json", config)


def _receptacle(receptacle: Receptacle, parent: str) -> Json:
    config: Json = {
        "name": receptacle.name,
        "parent_object": parent,
        "position": list(receptacle.center),
        "scale": list(receptacle.half_extents),
    }
    if receptacle.link is not None:
        config["parent_link"] = receptacle.link
    if receptacle.up != (0.0, 1.0, 0.0):
        config["up"] = list(receptacle.up)
    return config


def _write_articulation(model: Articulation, out: Path) -> None:
    folder = out / "urdf" / model.name
    lines = ['<?xml version="1.0" ?>', f'<robot name="{model.name}">']
    for link in model.links:
        if link.parts:
            write_parts(link.parts, folder / f"{link.name}.glb")
        lines += _link_xml(link)
    for joint in model.joints:
        lines += _joint_xml(joint)
    lines.append("</robot>")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{model.name}.urdf").write_text(
        "\n".join(lines) + "\n", encoding="utf-8", newline="\n"
    )
    user = {r.name: _receptacle(r, model.parent_object) for r in model.receptacles}
    config = {"urdf_filepath": f"{model.name}.urdf", "user_defined": user}
    _write_json(folder / f"{model.name}.ao_config.json", config)


def _link_xml(link: Link) -> list[str]:
    if not link.boxes:
        return [f'  <link name="{link.name}"/>']
    center, tensor = _inertia(link.boxes, link.mass_kg)
    xx, yy, zz, xy, xz, yz = (
        _number(v) for v in (*np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2])
    )
    lines = [
        f'  <link name="{link.name}">',
        "    <inertial>",
        f'      <origin xyz="{_triple(center)}" rpy="0 0 0"/>',
        f'      <mass value="{_number(link.mass_kg)}"/>',
        f'      <inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="{xy}" ixz="{xz}" iyz="{yz}"/>',
        "    </inertial>",
    ]
    if link.parts:
        lines += [
            "    <visual>",
            '      <origin xyz="0 0 0" rpy="0 0 0"/>',
            f'      <geometry><mesh filename="{link.name}.glb" scale="1 1 1"/></geometry>',
            "    </visual>",
        ]
    for box in link.boxes:
        lines += [
            "    <collision>",
            f'      <origin xyz="{_triple(box.center)}" rpy="0 0 0"/>',
            f'      <geometry><box size="{_triple(box.size)}"/></geometry>',
            "    </collision>",
        ]
    return [*lines, "  </link>"]


def _inertia(boxes: list[Box], mass_kg: float) -> tuple[Array, Array]:
    """Return the centre of mass (3,) m of boxes of one density, and their tensor (3, 3)."""
    volumes = np.array([float(np.prod(box.size)) for box in boxes])
    masses = mass_kg * volumes / volumes.sum()
    centers = np.array([box.center for box in boxes])
    center = masses @ centers / mass_kg
    tensor = np.zeros((3, 3))
    for mass, box in zip(masses, boxes, strict=True):
        squares = np.asarray(box.size) ** 2
        own = mass / 12 * np.diag(squares.sum() - squares)
        arm = np.asarray(box.center) - center
        tensor += own + mass * (float(arm @ arm) * np.eye(3) - np.outer(arm, arm))
    return center, tensor


def _joint_xml(joint: Joint) -> list[str]:
    # Sixteen digits for angles: a rounded right angle lets doors swing open under gravity.
    rpy = " ".join(repr(float(v)) if v else "0" for v in joint.rpy)
    lines = [
        f'  <joint name="{joint.name}" type="{joint.kind}">',
        f'    <origin xyz="{_triple(joint.xyz)}" rpy="{rpy}"/>',
        f'    <parent link="{joint.parent}"/>',
        f'    <child link="{joint.child}"/>',
    ]
    if joint.kind != "fixed":
        limits = f'lower="{_number(joint.lower)}" upper="{_number(joint.upper)}"'
        lines += [
            f'    <axis xyz="{_triple(joint.axis)}"/>',
            f'    <dynamics damping="0.01" friction="{_number(FRICTION[joint.kind])}"/>',
            f'    <limit effort="44.4" {limits} velocity="{_number(joint.velocity)}"/>',
        ]
    return [*lines, "  </joint>"]


def _lighting(lights: list[Light]) -> Json:
    return {
        "lights": {
            str(index): {
                "type": "point",
                "position": list(light.position),
                "intensity": light.intensity,
                "color": list(light.color),
            }
            for index, light in enumerate(lights)
        }
    }


def _scene(scene: SceneModel) -> Json:
    rigid = {"translation_origin": "COM"}
    jointed = {
        "motion_type": "DYNAMIC",
        "translation_origin": "COM",
        "fixed_base": True,
        "auto_clamp_joint_limits": True,
        "uniform_scale": 1.0,
    }
    return {
        "stage_instance": {
            "template_name": scene.stage,
            "translation": [0.0, 0.0, 0.0],
            "rotation": [1.0, 0.0, 0.0, 0.0],
            "translation_origin": "COM",
        },
        "default_lighting": f"lighting/{scene.lighting}",
        "object_instances": [
            _placement(p) | rigid | {"motion_type": "DYNAMIC" if p.dynamic else "STATIC"}
            for p in scene.objects
        ],
        "articulated_object_instances": [_placement(p) | jointed for p in scene.articulations],
    }


def _placement(placement: Placement) -> Json:
    tilt = placement.tilt_rad
    if placement.template in TURNED_BACK:
        tilt -= math.pi / 2
    cy, sy = math.cos(placement.yaw_rad / 2), math.sin(placement.yaw_rad / 2)
    ct, st = math.cos(tilt / 2), math.sin(tilt / 2)
    rotation = (cy * ct, cy * st, sy * ct, -sy * st)
    return {
        "template_name": placement.template,
        "translation": list(placement.translation),
        "rotation": [round(v, 15) + 0.0 for v in rotation],
    }


def _dataset_config(words: str) -> Json:
    folders = {"stages": "configs/stages", "objects": "configs/objects"}
    folders |= {"light_setups": "configs/lighting", "scene_instances": "configs/scenes"}
    config: Json = {key: {"paths": {".json": [path]}} for key, path in folders.items()}
    config["articulated_objects"] = {"paths": {".urdf": ["urdf/*/"]}}
    config["scene_instances"]["default_attributes"] = {"semantic_scene_instance": SEMANTICS}
    config["semantic_scene_descriptor_instances"] = {SEMANTICS: words}
    return config


def write_parts(parts: list[Part], path: Path) -> None:
    """Write visible parts as one GLB, one mesh per material."""
    scene = trimesh.Scene()
    for name in sorted({part.material for part in parts}):
        group = [part for part in parts if part.material == name]
        offsets = np.cumsum([0, *(len(p.positions) for p in group)])
        tile_m = materials.MATERIALS[name].tile_m
        mesh = trimesh.Trimesh(
            vertices=_rounded(np.vstack([p.positions for p in group]), POSITION_DIGITS),
            faces=np.vstack([p.faces + o for p, o in zip(group, offsets[:-1], strict=True)]),
            vertex_normals=_rounded(np.vstack([p.normals for p in group]), NORMAL_DIGITS),
            process=False,
        )
        uv = _rounded(np.vstack([p.uv_m for p in group]) / tile_m, UV_DIGITS)
        mesh.visual = TextureVisuals(uv=uv, material=materials.to_pbr(name))
        scene.add_geometry(mesh, node_name=name, geom_name=name)
    _write_glb(scene, path, normals=True)


def write_solids(solids: list[Convex], path: Path) -> None:
    """Write convex pieces as one GLB, one mesh node per piece."""
    scene = trimesh.Scene()
    for index, solid in enumerate(solids):
        name = f"convex_{index:03d}"
        mesh = trimesh.Trimesh(_rounded(solid.vertices, SOLID_DIGITS), solid.faces, process=False)
        mesh.visual = TextureVisuals()
        scene.add_geometry(mesh, node_name=name, geom_name=name)
    _write_glb(scene, path, normals=False)


def _write_glb(scene: trimesh.Scene, path: Path, *, normals: bool) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    data = export_glb(scene, include_normals=normals, tree_postprocessor=_drop_stamp)
    path.write_bytes(data)


def _drop_stamp(tree: Json) -> None:
    tree["asset"] = {"version": "2.0"}


def _rounded(values: Array, digits: int) -> Array:
    # Adding zero turns -0.0 into 0.0, whose bytes differ.
    return np.round(values, digits) + 0.0


def _write_json(path: Path, data: Json) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(_plain(data), indent=2, sort_keys=True)
    path.write_text(text + "\n", encoding="utf-8", newline="\n")


def _plain(value: object) -> object:
    if isinstance(value, dict):
        return {k: _plain(v) if k != "rotation" else v for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, float):
        return round(float(value), JSON_DIGITS) + 0.0
    return value


def _number(value: float) -> str:
    return f"{round(float(value), 7) + 0.0:.10g}"


def _triple(values: Iterable[float]) -> str:
    return " ".join(_number(v) for v in values)
