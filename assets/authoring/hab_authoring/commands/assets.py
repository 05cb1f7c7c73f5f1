"""`hab-tasks assets`: an optimised copy of a dataset."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import tyro

from hab_authoring.pipeline.options import AssetOptions
from hab_tasks.console import Command
from hab_tasks.generation_lines import progress_bar

if TYPE_CHECKING:
    from hab_authoring.pipeline.footprint import Footprint

LINES = 10
"""Number of progress lines when stdout is not a terminal."""


@dataclass(frozen=True, kw_only=True)
class Assets(Command):
    """Options of `hab-tasks assets`."""

    help: ClassVar[str] = """Writes an optimised copy of a dataset: less memory, faster collisions.

The printed sizes are computed from the dataset's GLB visuals, each file once, without --objects:
56 bytes per vertex, 4 per index, and 4 per texture pixel (1/2 or 1 when compressed).
`python -m hab_authoring.pipeline.measure DATASET DIR` measures the memory of a rendering process.

Example:
  hab-tasks assets ~/data/replica_cad --objects ~/data/ycb --collision coacd --out ~/data/light"""

    dataset: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="DATASET")]
    """`apartment` or the path of a ReplicaCAD folder; left unchanged."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Output folder; use it as --scene-dataset DIR, and DIR/ycb as --objects."""
    collision: Annotated[str, tyro.conf.arg(metavar="HOW")] = "coacd"
    """coacd: at most 20 convex parts; hull: one hull per part; merged-hull: one hull; or box."""
    recompute: bool = False
    """Compute collision parts from the visual meshes even if the dataset has convex parts."""
    decimate: Annotated[float, tyro.conf.arg(metavar="F")] = 0.5
    """Share of triangles to keep; more are kept where the shape would change."""
    texture_size: Annotated[int, tyro.conf.arg(metavar="PX")] = 1024
    """Maximum texture width and height."""
    texture_format: Annotated[str, tyro.conf.arg(metavar="FORMAT")] = "ktx2"
    """ktx2: GPU-compressed, for SAPIEN; png: readable by any program."""
    objects: Annotated[Path | None, tyro.conf.arg(metavar="PATH")] = None
    """A YCB folder, copied to DIR/ycb."""
    workers: Annotated[int, tyro.conf.arg(metavar="W")] = os.cpu_count() or 1
    """Number of worker processes."""
    force: bool = False
    """Replace the dataset at DIR."""

    def run(self) -> int:
        """Writes the copy, then prints the sizes before and after."""
        from hab_authoring.pipeline.optimise import OBJECTS_FOLDER, optimise
        from hab_tasks.scenes.habitat.dataset import resolve_dataset

        dataset = resolve_dataset(self.dataset)
        options = AssetOptions(
            collision=self.collision,
            recompute=self.recompute,
            decimate=self.decimate,
            texture_px=self.texture_size,
            texture_format=self.texture_format,
        )
        with progress_bar("mesh", _line) as progress:
            report = optimise(
                dataset,
                self.out,
                options,
                objects=self.objects,
                workers=self.workers,
                force=self.force,
                progress=progress,
            )
        tally = report.tally
        print(f"wrote {report.out}: {tally.computed} meshes computed, {tally.reused} reused")
        print(f"  visual meshes before  {_sizes(report.before)}")
        print(f"  visual meshes after   {_sizes(report.after)}")
        if report.after.total_bytes:
            times = report.before.total_bytes / report.after.total_bytes
            print(f"  memory, counted       {times:.1f} times less")
        if self.objects is not None:
            print(f"  movable objects       {report.out / OBJECTS_FOLDER}")
        return 0


def _sizes(footprint: Footprint) -> str:
    meshes, textures = (n / 1e6 for n in (footprint.mesh_bytes, footprint.texture_bytes))
    return f"{footprint.triangles} triangles, {meshes:.1f} MB, textures {textures:.1f} MB"


def _line(done: int, count: int) -> None:
    """Prints some of the lines of a log."""
    if done and done * LINES // count > (done - 1) * LINES // count:
        print(f"{done} of {count} meshes", flush=True)
