"""`hab-tasks assets`: an optimised copy of a dataset."""

from __future__ import annotations

from hab_authoring.commands.options import Assets
from hab_authoring.pipeline.jobs import AssetOptions
from hab_authoring.pipeline.optimise import OBJECTS_FOLDER, Footprint, optimise
from hab_tasks.io.console import progress_bar
from hab_tasks.world.scenes.habitat.dataset import resolve_dataset

LINES = 10
"""Number of progress lines when stdout is not a terminal."""


def run(options: Assets) -> int:
    """Writes the copy, then prints the sizes before and after."""
    dataset = resolve_dataset(options.dataset)
    settings = AssetOptions(
        collision=options.collision,
        recompute=options.recompute,
        decimate=options.decimate,
        texture_px=options.texture_size,
        texture_format=options.texture_format,
    )
    with progress_bar("mesh", _line) as progress:
        report = optimise(
            dataset,
            options.out,
            settings,
            objects=options.objects,
            workers=options.workers,
            force=options.force,
            progress=progress,
        )
    tally = report.tally
    print(f"wrote {report.out}: {tally.computed} meshes computed, {tally.reused} reused")
    print(f"  visual meshes before  {_sizes(report.before)}")
    print(f"  visual meshes after   {_sizes(report.after)}")
    if report.after.total_bytes:
        times = report.before.total_bytes / report.after.total_bytes
        print(f"  memory, counted       {times:.1f} times less")
    if options.objects is not None:
        print(f"  movable objects       {report.out / OBJECTS_FOLDER}")
    return 0


def _sizes(footprint: Footprint) -> str:
    meshes, textures = (n / 1e6 for n in (footprint.mesh_bytes, footprint.texture_bytes))
    return f"{footprint.triangles} triangles, {meshes:.1f} MB, textures {textures:.1f} MB"


def _line(done: int, count: int) -> None:
    """Prints some of the lines of a log."""
    if done and done * LINES // count > (done - 1) * LINES // count:
        print(f"{done} of {count} meshes", flush=True)
