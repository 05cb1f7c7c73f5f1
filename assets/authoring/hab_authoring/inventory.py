"""Inventory of a scene dataset, compared with the complete ReplicaCAD."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from hab_tasks.errors import UnknownNameError
from hab_tasks.geometry import IDENTITY
from hab_tasks.object_names import ALL_OBJECTS
from hab_tasks.world.scenes.build import BodyBuilder
from hab_tasks.world.scenes.fields import is_present, read_fields
from hab_tasks.world.scenes.habitat.dataset import SPLIT_MACROS, SceneDataset, embedded_dataset
from hab_tasks.world.scenes.habitat.load import (
    articulated_receptacles,
    load_scene,
    load_template,
    read_category,
    read_lamps,
)
from hab_tasks.world.scenes.habitat.navmesh import read_navmesh
from hab_tasks.world.scenes.objects import resolve_objects
from hab_tasks.world.scenes.physics import bare_scene
from hab_tasks.world.scenes.spec import ArticulationInstance, Stage
from hab_tasks.world.scenes.urdf import check_urdf
from hab_tasks.world.scenes.walls import NAVMESHES

COMPLETE = (
    *(f"apt_{number}" for number in range(6)),
    *(f"v3_sc{macro}_staging_{micro:02d}" for macro in range(5) for micro in range(21)),
)
"""The 111 layouts of ReplicaCAD (S A.2): 6 recreations of one flat, 5 macro layouts, 100 micros."""

_STAGING = re.compile(r"^v3_(sc\d)_staging_(\d\d)$")


@dataclass(frozen=True, kw_only=True)
class Inventory:
    """Present and missing parts of a dataset.

    Attributes:
        layouts: All scene ids, sorted.
        absent_layouts: Missing layouts of `COMPLETE`.
        templates: Number of object templates, without `movable`.
        movable: Number of templates of the objects that tasks move.
        convex: Number of templates of either kind with convex parts; the others are boxes.
        absent_meshes: Template without a mesh -> number of layouts that use it.
        absent_parts: Templates whose convex parts are missing.
        categories: Names of the semantic categories of `templates`.
        furniture: Names of the articulated templates.
        receptacles: Names of all receptacles in the layouts.
        navmeshes: Number of layouts with a navmesh.
        stages: Names of the stage meshes of the layouts.
        absent_stages: Stages without a mesh.
        licence: The licence's file.
    """

    layouts: tuple[str, ...]
    absent_layouts: tuple[str, ...]
    templates: int
    movable: int
    convex: int
    absent_meshes: dict[str, int]
    absent_parts: tuple[str, ...]
    categories: tuple[str, ...]
    furniture: tuple[str, ...]
    receptacles: tuple[str, ...]
    navmeshes: int
    stages: tuple[str, ...]
    absent_stages: tuple[str, ...]
    licence: Path | None


def take_inventory(dataset: SceneDataset) -> Inventory:
    """Reads every layout and template.

    Raises:
        DatasetError: A file is damaged.
    """
    specs = [load_scene(dataset, scene_id) for scene_id in sorted(dataset.scene_files)]
    check_files(dataset, [spec.stage for spec in specs])
    templates = {name: load_template(file) for name, file in dataset.object_files.items()}
    own = [file for name, file in dataset.object_files.items() if name not in ALL_OBJECTS]
    missing = Counter(name for spec in specs for name in spec.missing)
    stages = {spec.stage.name: spec.stage.visual_file for spec in specs}
    return Inventory(
        layouts=tuple(sorted(dataset.scene_files)),
        absent_layouts=() if dataset.layouts else _absent_layouts(dataset),
        templates=len(own),
        movable=len(templates) - len(own),
        convex=sum(
            any(source.kind == "convex_parts" for source in template.collision)
            for template in templates.values()
            if template is not None
        ),
        absent_meshes={name: missing[name] for name, t in sorted(templates.items()) if t is None},
        absent_parts=tuple(n for n, file in dataset.object_files.items() if _parts_absent(file)),
        categories=tuple(sorted(set(map(read_category, own)) - {""})),
        furniture=tuple(sorted(dataset.urdf_files)),
        receptacles=tuple(sorted({r.name for spec in specs for r in spec.receptacles})),
        navmeshes=sum(dataset.navmesh_file(s) is not None for s in dataset.scene_files),
        stages=tuple(sorted(stages)),
        absent_stages=tuple(sorted(name for name, visual in stages.items() if visual is None)),
        licence=_licence(dataset.source.root),
    )


def check_files(dataset: SceneDataset, stages: list[Stage]) -> None:
    """Checks templates, furniture, stages, lamps and navmeshes.

    Args:
        dataset: Whose files.
        stages: The stages of its layouts.

    Raises:
        DatasetError: A file is damaged, or the engine can make no body from it.
    """
    builder = BodyBuilder(bare_scene())
    for name, file in dataset.object_files.items():
        template = load_template(file)
        if template is not None:
            builder.static(name, template, IDENTITY, 1.0)
    for number, (name, urdf) in enumerate(dataset.urdf_files.items()):
        check_urdf(urdf)
        piece = ArticulationInstance(
            name=f"furniture-{name}", template=name, urdf_file=urdf, world_from_root=IDENTITY
        )
        articulated_receptacles(piece)
        builder.articulation(piece, number + 1)
    convex = {stage.name: stage for stage in stages if stage.collision[0].file is not None}
    for stage in convex.values():
        builder.stage(stage)
    for file in dataset.lighting_files.values():
        read_lamps(file)
    navmeshes = [dataset.navmesh_file(scene_id) for scene_id in dataset.scene_files]
    for file in {*navmeshes, *(dataset.source.root / NAVMESHES).glob("*.navmesh")} - {None}:
        assert file is not None
        read_navmesh(file)


def macro_of(scene_id: str) -> str | None:
    """Returns the macro layout of a staging scene (``sc0``), None for any other scene."""
    match = _STAGING.match(scene_id)
    return match[1] if match else None


def macro_layouts(dataset: SceneDataset) -> list[str]:
    """Returns the scene ids of the macro layouts, sorted."""
    return [s for s in sorted(dataset.scene_files) if (m := _STAGING.match(s)) and m[2] == "00"]


def macros_of_split(dataset: SceneDataset, split: str) -> list[str]:
    """Returns the macro layouts of a split, sorted.

    Raises:
        UnknownNameError: There is no such split, or none of its macro layouts are in the dataset.
    """
    macros = set(macro_layouts(dataset))
    of_split = {name: sorted(macros & set(dataset.scenes_of_split(name))) for name in SPLIT_MACROS}
    present = {name: scenes for name, scenes in of_split.items() if scenes}
    if split not in present:
        raise UnknownNameError("split with macro layouts", split, present)
    return present[split]


def micro_variations(dataset: SceneDataset, macro: str | None = None) -> list[str]:
    """Returns the scene ids of the micro-variations, of all macro layouts or of one (``sc0``)."""
    return [
        s
        for s in sorted(dataset.scene_files)
        if (m := _STAGING.match(s)) and m[2] != "00" and macro in (None, m[1])
    ]


def absent_objects(folder: str | Path) -> list[str]:
    """Returns which of the 13 movable objects a YCB folder lacks.

    Raises:
        UnknownNameError: There is no such folder.
        DatasetError: ManiSkill has not downloaded it.
    """
    root = resolve_objects(folder)
    models = root / "models" if (root / "models").is_dir() else root
    return [name for name in ALL_OBJECTS if not (models / name).is_dir()]


def _absent_layouts(dataset: SceneDataset) -> tuple[str, ...]:
    return tuple(s for s in COMPLETE if s not in dataset.scene_files)


def _licence(root: Path) -> Path | None:
    # The embedded dataset's is that of all shipped assets.
    folders = (root, root.parent) if root == embedded_dataset().resolve() else (root,)
    return next((f for folder in folders for f in sorted(folder.glob("LICEN[CS]E*"))), None)


def _parts_absent(file: Path) -> bool:
    config = read_fields(file)
    if not config.text("collision_asset", "") or config.flag("use_bounding_box_for_collision"):
        return False
    return not is_present(config.path("collision_asset"))
