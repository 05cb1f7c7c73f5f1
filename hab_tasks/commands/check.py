"""`hab-tasks check`: one page about a dataset."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import tyro

from hab_tasks.commands.base import Command
from hab_tasks.scenes.dataset import SPLIT_MACROS, resolve_dataset
from hab_tasks.scenes.load import load_scene
from hab_tasks.scenes.objects import load_objects


@dataclass(frozen=True, kw_only=True)
class Check(Command):
    """Options of `hab-tasks check`."""

    help: ClassVar[
        str
    ] = """Reads every layout and object of a dataset; tells what is there and what is missing.

Example:
  hab-tasks check ~/data/replica_cad --objects ~/data/ycb"""

    dataset: tyro.conf.Positional[str]
    """`apartment` or the path of a ReplicaCAD folder."""
    objects: Annotated[str | None, tyro.conf.arg(metavar="PATH")] = None
    """A YCB folder to check as well."""

    def run(self) -> int:
        """Prints the page; a damaged file raises."""
        dataset = resolve_dataset(self.dataset)
        specs = [load_scene(dataset, scene_id) for scene_id in sorted(dataset.scene_files)]
        missing = sorted({name for spec in specs for name in spec.missing})
        no_stage = sorted({s.stage.name for s in specs if s.stage.visual_file is None})
        receptacles = len({r.name for spec in specs for r in spec.receptacles})
        counts = ", ".join(f"{name} {len(dataset.scenes_of_split(name))}" for name in SPLIT_MACROS)
        print(f"{dataset.name} in {dataset.root}")
        print(f"  layouts        {len(specs)}: {counts}")
        print(
            f"  templates      {len(dataset.object_files)} objects, {len(dataset.urdf_files)} URDFs"
        )
        print(f"  receptacles    {receptacles} names")
        print(f"  stage meshes   {_absent(no_stage, 'a shell of floor and outer walls stands in')}")
        print(f"  object meshes  {_absent(missing, 'skipped in every layout')}")
        if self.objects is not None:
            objects = load_objects(self.objects)
            masses = ", ".join(f"{name} {o.mass_kg:.3f} kg" for name, o in sorted(objects.items()))
            print(f"  movable        {len(objects)} objects: {masses}")
        return 0


def _absent(names: list[str], remedy: str) -> str:
    return f"absent: {', '.join(names)} ({remedy})" if names else "all there"
