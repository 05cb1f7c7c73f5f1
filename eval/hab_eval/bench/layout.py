"""A temporary copy of ReplicaCAD in the folder structure of ManiSkill's own scene builder.

The user's folder is not modified. Files are copied, not linked, because SAPIEN writes caches beside
the meshes it loads.
"""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import trimesh

from hab_eval.errors import BenchError
from hab_tasks.errors import UnknownNameError

SCENE_SUFFIX = ".scene_instance.json"
LAYOUT = Path("data") / "scene_datasets" / "replica_cad_dataset"
"""Dataset folder of ManiSkill, below MS_ASSET_DIR."""

FLOOR_SIZE_M = (40.0, 0.1, 40.0)
"""Box that replaces the missing mesh of a stage; y is up in the dataset."""

PLACEHOLDER_SIZE_M = (0.05, 0.05, 0.05)
"""Box that replaces the missing mesh of an object."""

NUMBERS = re.compile(r'"[-+.,\s\deE]+"')
"""A quoted list of numbers, as in size="0.617 0.145, 0.894"."""


def scene_ids(dataset: Path) -> list[str]:
    """Returns the ids of all scenes of a dataset."""
    found = (dataset / "configs" / "scenes").glob(f"*{SCENE_SUFFIX}")
    return sorted(path.name.removesuffix(SCENE_SUFFIX) for path in found)


def check_scenes(dataset: Path, scenes: Iterable[str]) -> None:
    """Raises unless `dataset` is a ReplicaCAD folder with all `scenes`."""
    valid = scene_ids(dataset)
    if not valid:
        raise BenchError(f"{dataset}: not a ReplicaCAD folder, no configs/scenes/*{SCENE_SUFFIX}.")
    for scene in scenes:
        if scene not in valid:
            raise UnknownNameError(f"scene of {dataset}", scene, valid)


def make_layout(dataset: Path, scenes: Iterable[str], asset_dir: Path) -> None:
    """Writes the dataset with `scenes` below `asset_dir`."""
    target = asset_dir / LAYOUT
    shutil.copytree(dataset / "objects", target / "objects", copy_function=shutil.copyfile)
    for name in ("scenes", "objects"):
        source = dataset / "configs" / name
        shutil.copytree(source, target / "configs" / name, copy_function=shutil.copyfile)
    for scene in scenes:
        config = _read(target / "configs" / "scenes" / f"{scene}{SCENE_SUFFIX}")
        _add_stage(dataset, target, config)
        _add_articulations(dataset, target, config)
        _add_missing_objects(target, config)


def _add_stage(dataset: Path, target: Path, scene: Mapping[str, Any]) -> None:
    """Copies a scene's stage; a missing mesh is replaced with a floor."""
    name = Path(scene["stage_instance"]["template_name"]).name + ".glb"
    source, copy = dataset / "stages" / name, target / "stages" / name
    if source.is_file():
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, copy)
    else:
        below = trimesh.transformations.translation_matrix([0.0, -FLOOR_SIZE_M[1] / 2, 0.0])
        _write_box(copy, FLOOR_SIZE_M, below)


def _add_articulations(dataset: Path, target: Path, scene: Mapping[str, Any]) -> None:
    """Copies the articulated models to `urdf/<template>/<template>.urdf`."""
    sources = {path.stem: path for path in sorted((dataset / "urdf").glob("*/*.urdf"))}
    for articulation in scene["articulated_object_instances"]:
        template = Path(articulation["template_name"]).name
        folder = target / "urdf" / template
        if folder.exists():
            continue
        if template not in sources:
            raise UnknownNameError(f"articulation of {dataset}", template, sources)
        shutil.copytree(sources[template].parent, folder, copy_function=shutil.copyfile)
        urdf = folder / f"{template}.urdf"
        text = urdf.read_text(encoding="utf-8")
        # The files have commas, which NumPy 2 no longer reads as white space.
        urdf.write_text(NUMBERS.sub(lambda m: m.group().replace(",", " "), text), encoding="utf-8")


def _add_missing_objects(target: Path, scene: Mapping[str, Any]) -> None:
    """Writes a small box for each missing mesh."""
    configs = target / "configs" / "objects"
    for instance in scene["object_instances"]:
        config = _read(configs / f"{Path(instance['template_name']).name}.object_config.json")
        for key in ("render_asset", "collision_asset"):
            mesh = (configs / config[key]).resolve() if key in config else None
            if mesh is not None and not mesh.is_file():
                _write_box(mesh, PLACEHOLDER_SIZE_M, trimesh.transformations.identity_matrix())


def _write_box(path: Path, size_m: tuple[float, float, float], pose: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    trimesh.Scene(trimesh.creation.box(extents=size_m, transform=pose)).export(path)


def _read(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8"))
