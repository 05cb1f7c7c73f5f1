"""`hab-tasks figures`: the paper's figures of a dataset and of episode files, as PNG."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

from tqdm import tqdm

from hab_authoring.commands.options import Figures
from hab_authoring.figures.layouts import draw_macros, draw_micros, draw_wild
from hab_authoring.figures.rearrangement import draw_episodes, figure_name
from hab_authoring.figures.statistics import draw_categories, draw_furniture
from hab_authoring.inventory import macro_layouts, micro_variations
from hab_tasks.episodes import read_episodes
from hab_tasks.errors import EpisodeError, HabError, RenderingUnavailableError
from hab_tasks.io.files import check_file
from hab_tasks.rendering import resolve_backend
from hab_tasks.world.scenes.habitat.dataset import SceneDataset, resolve_dataset

Draw = Callable[[Path], None]


def run(options: Figures) -> int:
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
