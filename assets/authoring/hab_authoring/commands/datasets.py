"""`hab-tasks assets`, `figures` and `convert`: optimised copies, figures, Habitat's format."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from tqdm import tqdm

from hab_authoring.commands.options import Assets, Convert, Figures
from hab_authoring.figures.layouts import draw_macros, draw_micros, draw_wild
from hab_authoring.figures.rearrangement import draw_episodes, figure_name
from hab_authoring.figures.statistics import draw_categories, draw_furniture
from hab_authoring.habitat.convert import OWN_KEY, draw_starts, is_habitat, read_habitat, to_habitat
from hab_authoring.habitat.entry import START
from hab_authoring.inventory import macro_layouts, micro_variations
from hab_authoring.pipeline.jobs import AssetOptions
from hab_authoring.pipeline.optimise import OBJECTS_FOLDER, Footprint, optimise
from hab_tasks.commands.episodes import check_ending
from hab_tasks.episodes.schema import read_episodes, save_json, write_episodes
from hab_tasks.errors import EpisodeError, HabError, RenderingUnavailableError
from hab_tasks.io.console import progress_bar
from hab_tasks.io.files import check_file
from hab_tasks.registration import imported_id
from hab_tasks.rendering import resolve_backend
from hab_tasks.world.scenes.habitat.dataset import SceneDataset, resolve_dataset
from hab_tasks.world.scenes.objects import load_objects
from hab_tasks.world.scenes.spec import ObjectTemplate

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


def run_convert(options: Convert) -> int:
    """Converts the file, then prints a summary."""
    check_ending(options.out)
    check_file(options.out, force=options.force)
    if options.env is not None:
        imported_id(options.env)
    dataset, objects = resolve_dataset(options.scene_dataset), load_objects(options.objects)
    convert = _from_habitat if is_habitat(options.source) else _to_habitat
    convert(options, dataset, objects)
    return 0


def _from_habitat(
    options: Convert, dataset: SceneDataset, objects: Mapping[str, ObjectTemplate]
) -> None:
    with progress_bar("episode") as progress:
        made = read_habitat(options.source, dataset, objects, options.env, progress)
    with progress_bar("start") as progress:
        made = draw_starts(made, dataset, objects, progress)
    write_episodes(made, options.out)
    print(f"wrote {len(made)} episodes ({made.split}) for {made.env} to {options.out}")
    kept = Counter(key for e in made.episodes for key in e.habitat.get("kept", ()))
    print(f"  kept for conversion back: {_listed(kept)}")
    drawn = sum(START in e.habitat for e in made.episodes)
    print(f"  robot starts, which Habitat samples at each reset, sampled once: {drawn}")
    print("  dropped: nothing")


def _to_habitat(
    options: Convert, dataset: SceneDataset, objects: Mapping[str, ObjectTemplate]
) -> None:
    with progress_bar("episode") as progress:
        raw = to_habitat(read_episodes(options.source), dataset, objects, progress)
    save_json(raw, options.out, sort_keys=False)
    print(f"wrote {len(raw['episodes'])} episodes in Habitat's format to {options.out}")
    own: list[Mapping[str, Any]] = [(e.get("info") or {}).get(OWN_KEY, {}) for e in raw["episodes"]]
    beside = Counter(key for fields in (*own, raw.get(OWN_KEY, {})) for key in fields)
    print(f"  stored under {OWN_KEY!r}, which Habitat ignores: {_listed(beside)}")
    print("  dropped: nothing")


def _listed(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{name} ({times})" for name, times in sorted(counts.items())) or "nothing"
