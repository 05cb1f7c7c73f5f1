"""`hab-tasks assets` and `figures`: an optimised copy of a dataset, and its figures as PNG."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

from tqdm import tqdm

from hab_authoring.commands.options import Assets, Figures
from hab_authoring.figures.layouts import draw_macros, draw_micros, draw_wild
from hab_authoring.figures.rearrangement import draw_episodes, figure_name
from hab_authoring.figures.statistics import draw_categories, draw_furniture
from hab_authoring.inventory import macro_layouts, micro_variations
from hab_authoring.pipeline.jobs import AssetOptions
from hab_authoring.pipeline.optimise import OBJECTS_FOLDER, Footprint, optimise
from hab_tasks.episodes import read_episodes
from hab_tasks.errors import EpisodeError, HabError, RenderingUnavailableError
from hab_tasks.io.console import progress_bar
from hab_tasks.io.files import check_file
from hab_tasks.rendering import resolve_backend
from hab_tasks.world.scenes.habitat.dataset import SceneDataset, resolve_dataset

LINES = 10
"""Number of progress lines when stdout is not a terminal."""


def run_assets(options: Assets) -> int:
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


Draw = Callable[[Path], None]


def run_figures(options: Figures) -> int:
    """Draws every figure, then prints the files and the figures left out."""
    dataset = resolve_dataset(options.dataset)
    jobs, notes = _dataset_jobs(dataset)
    jobs |= _episode_jobs(options.episodes, dataset)
    for name in jobs:
        check_file(options.out / name, force=options.force)
    for name, draw in tqdm(jobs.items(), unit="figure", disable=None):
        draw(options.out / name)
    for line in [f"wrote {options.out / name}" for name in jobs] + notes:
        print(line)
    return 0


def _dataset_jobs(dataset: SceneDataset) -> tuple[dict[str, Draw], list[str]]:
    """Returns file name -> draw function, and notes on figures left out."""
    jobs: dict[str, Draw] = {"fig07_categories.png": partial(draw_categories, dataset)}
    notes = []
    if micro_variations(dataset):
        jobs["fig06_furniture.png"] = partial(draw_furniture, dataset)
        jobs["fig08_micro_variations.png"] = partial(draw_micros, dataset)
    else:
        notes.append(f"{dataset.name} has no micro-variations: fig06 and their sheet left out")
    if dataset.layouts is not None and dataset.layouts.wild:
        jobs["fig_wild_layouts.png"] = partial(draw_wild, dataset)
    if macro_layouts(dataset):
        backend = "none"
        try:
            backend = resolve_backend("auto", wants_images=True)
        except RenderingUnavailableError as error:
            notes.append(f"fig08 shows floor plans. {error}")
        jobs["fig08_macro_layouts.png"] = partial(draw_macros, dataset, backend=backend)
    else:
        notes.append(f"{dataset.name} has no macro layouts: fig08 left out")
    return dict(sorted(jobs.items())), notes


def _episode_jobs(files: Iterable[Path], dataset: SceneDataset) -> dict[str, Draw]:
    jobs: dict[str, Draw] = {}
    for file in files:
        episodes = read_episodes(file)
        name = figure_name(episodes.env)
        if episodes.scene_dataset != dataset.name:
            raise EpisodeError(
                f"{file}: made for {episodes.scene_dataset}, not for {dataset.name}."
            )
        if not len(episodes):
            raise EpisodeError(f"{file}: contains no episodes.")
        if name in jobs:
            raise HabError(f"{file}: second file for {episodes.env}; give one per environment.")
        for episode in episodes.episodes:
            dataset.scene_file(episode.scene_id)
        jobs[name] = partial(draw_episodes, dataset, episodes)
    return jobs
