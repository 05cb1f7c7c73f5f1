"""Writes layouts: ``layouts.json``, and the poses of each in Habitat's format, y-up."""

from __future__ import annotations

import copy
import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from hab_tasks.geometry import (
    WORLD_FROM_HABITAT,
    Array,
    compose,
    from_matrix,
    inverse,
    to_matrix,
)
from hab_tasks.io.files import written_aside
from hab_tasks.world.scenes.fields import read_json
from hab_tasks.world.scenes.habitat.dataset import (
    LAYOUTS_FILE,
    LAYOUTS_FORMAT,
    LayoutSet,
    SceneDataset,
)
from hab_tasks.world.scenes.spec import ObjectInstance, SceneSpec

POSITION_DIGITS, ROTATION_DIGITS = 6, 9
SCENE_SUFFIX = ".scene_instance.json"


def moved_scene(
    dataset: SceneDataset,
    spec: SceneSpec,
    motions: Mapping[str, Array],
    changed: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Returns the content of a scene file in which some pieces have moved.

    Args:
        dataset: Dataset of the scene.
        spec: The scene as loaded.
        motions: Handle of an object or of furniture -> motion (4, 4) in the world.
        changed: Content that it was loaded from instead of its file.
    """
    scene = copy.deepcopy(dict(changed or read_json(dataset.scene_file(spec.scene_id))))
    entries = [e for e in scene.get("object_instances", []) if _template(e) not in spec.missing]
    furniture = scene.get("articulated_object_instances", [])
    for items, own in ((spec.objects, entries), (spec.articulations, furniture)):
        for item, entry in zip(items, own, strict=True):
            motion = motions.get(item.name)
            if motion is not None and not np.array_equal(motion, np.eye(4)):
                is_object = isinstance(item, ObjectInstance)
                own_pose = item.world_from_object if is_object else item.world_from_root
                moved = from_matrix(motion @ to_matrix(own_pose))
                pose = compose(inverse(WORLD_FROM_HABITAT), moved)
                entry["translation"] = [round(x, POSITION_DIGITS) + 0.0 for x in pose[:3]]
                entry["rotation"] = _rotation(pose[3:])
    return scene


def _rotation(wxyz: tuple[float, ...]) -> list[float]:
    """Returns a rotation as one of its two quaternions, without the noise of its computation."""
    rounded = [round(x, ROTATION_DIGITS) + 0.0 for x in wxyz]
    first = next(x for x in rounded if x)
    return rounded if first > 0 else [-x + 0.0 for x in rounded]


def write_scene(scene: Mapping[str, Any], folder: Path, scene_id: str) -> Path:
    """Writes a scene_instance file atomically; returns its path."""
    path = folder / f"{scene_id}{SCENE_SUFFIX}"
    with written_aside(path) as scratch:
        scratch.write_text(json.dumps(scene, indent=2) + "\n", encoding="utf-8")
    return path


def write_layout_set(layouts: LayoutSet, folder: Path) -> None:
    """Writes ``layouts.json``, which makes the folder a dataset."""
    with written_aside(folder / LAYOUTS_FILE) as scratch:
        text = json.dumps({"format": LAYOUTS_FORMAT} | asdict(layouts), indent=2)
        scratch.write_text(text + "\n", encoding="utf-8")


def _template(entry: Mapping[str, Any]) -> str:
    return Path(entry["template_name"]).name.removesuffix(".object_config.json")
