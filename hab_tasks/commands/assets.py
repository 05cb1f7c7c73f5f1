"""`hab-tasks assets`: an optimised copy of a dataset."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import tyro
from tqdm import tqdm

from hab_tasks.commands.base import Command
from hab_tasks.pipeline.options import AssetOptions

if TYPE_CHECKING:
    from hab_tasks.pipeline.footprint import Footprint

LINES = 10
"""Without a terminal, progress is told in so many lines."""


@dataclass(frozen=True, kw_only=True)
class Assets(Command):
    """Options of `hab-tasks assets`."""

    help: ClassVar[str] = """Writes a copy of a dataset that needs less memory and collides faster.

The sizes printed are counted from the GLB visuals of the dataset, each file once, not --objects:
vertices (56 bytes), indices (4) and pixels of textures (4, or compressed to 1/2 or 1).
`python -m hab_tasks.pipeline.measure DATASET DIR` measures a process that draws them.

Example:
  hab-tasks assets ~/data/replica_cad --objects ~/data/ycb --collision coacd --out ~/data/light"""

    dataset: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="DATASET")]
    """`apartment` or the path of a ReplicaCAD folder; it is not changed."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """The copy; use it as --scene-dataset DIR, and DIR/ycb as --objects."""
    collision: Annotated[str, tyro.conf.arg(metavar="HOW")] = "coacd"
    """coacd: at most 20 convex parts; hull: a hull of each part; merged-hull: one hull; box."""
    recompute: bool = False
    """Make collision parts from the visual meshes even where the dataset brings convex parts."""
    decimate: Annotated[float, tyro.conf.arg(metavar="F")] = 0.5
    """Share of the triangles to keep; more stay where a mesh would change its shape."""
    texture_size: Annotated[int, tyro.conf.arg(metavar="PX")] = 1024
    """Largest width and height of a texture."""
    texture_format: Annotated[str, tyro.conf.arg(metavar="FORMAT")] = "ktx2"
    """ktx2: compressed for the GPU, for SAPIEN; png: for any program."""
    objects: Annotated[Path | None, tyro.conf.arg(metavar="PATH")] = None
    """A YCB folder, copied to DIR/ycb."""
    workers: Annotated[int, tyro.conf.arg(metavar="W")] = os.cpu_count() or 1
    """Number of processes."""
    force: bool = False
    """Replace the dataset at DIR."""

    def run(self) -> int:
        """Writes the copy, then prints what became smaller."""
        from hab_tasks.pipeline.optimise import OBJECTS_FOLDER, optimise
        from hab_tasks.scenes.dataset import resolve_dataset

        dataset = resolve_dataset(self.dataset)
        options = AssetOptions(
            collision=self.collision,
            recompute=self.recompute,
            decimate=self.decimate,
            texture_px=self.texture_size,
            texture_format=self.texture_format,
        )
        with _progress() as progress:
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


@contextmanager
def _progress() -> Iterator[Callable[[int, int], None]]:
    """Yields what shows progress: a bar on a terminal, a few lines elsewhere."""
    with tqdm(unit="mesh", disable=not sys.stderr.isatty()) as bar:

        def show(done: int, count: int) -> None:
            bar.total = count
            bar.update(done - bar.n)
            if bar.disable and done and done * LINES // count > (done - 1) * LINES // count:
                print(f"{done} of {count} meshes", flush=True)

        yield show
