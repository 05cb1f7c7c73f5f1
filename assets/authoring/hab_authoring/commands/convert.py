"""`hab-tasks convert`: conversion of episode files from and to Habitat."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

from hab_authoring.commands.options import Convert
from hab_authoring.habitat.convert import OWN_KEY, draw_starts, is_habitat, read_habitat, to_habitat
from hab_authoring.habitat.entry import START
from hab_tasks.commands.episodes import check_ending
from hab_tasks.episodes.schema import read_episodes, save_json, write_episodes
from hab_tasks.io.console import progress_bar
from hab_tasks.io.files import check_file
from hab_tasks.registration import imported_id
from hab_tasks.world.scenes.habitat.dataset import SceneDataset, resolve_dataset
from hab_tasks.world.scenes.objects import load_objects
from hab_tasks.world.scenes.spec import ObjectTemplate


def run(options: Convert) -> int:
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
