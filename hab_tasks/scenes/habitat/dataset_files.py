"""Validation of all files of a dataset, whether a layout uses them or not."""

from __future__ import annotations

from hab_tasks.geometry import IDENTITY
from hab_tasks.scenes.build import BodyBuilder
from hab_tasks.scenes.habitat.dataset import SceneDataset
from hab_tasks.scenes.habitat.lamps import read_lamps
from hab_tasks.scenes.habitat.load import articulated_receptacles, load_template
from hab_tasks.scenes.habitat.navmesh import read_navmesh
from hab_tasks.scenes.physics import bare_scene
from hab_tasks.scenes.spec import ArticulationInstance, Stage
from hab_tasks.scenes.urdf import check_urdf
from hab_tasks.scenes.walls import NAVMESHES


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
