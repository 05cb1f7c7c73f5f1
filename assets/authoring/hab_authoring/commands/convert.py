"""`hab-tasks convert`: conversion of episode files from and to Habitat."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import tyro

from hab_tasks.commands.episodes import check_ending
from hab_tasks.console import Command
from hab_tasks.files import check_file
from hab_tasks.generation_lines import progress_bar
from hab_tasks.registration import imported_id

if TYPE_CHECKING:
    from hab_tasks.scenes.habitat.dataset import SceneDataset
    from hab_tasks.scenes.spec import ObjectTemplate


@dataclass(frozen=True, kw_only=True)
class Convert(Command):
    """Options of `hab-tasks convert`."""

    help: ClassVar[str] = """Converts rearrangement episodes from Habitat's format, or to it.

The direction follows from the file. Prints the fields that the other format lacks, and where they
are kept.

Example:
  hab-tasks convert tidy_house.json.gz --scene-dataset ~/data/replica_cad --out tidy.json.gz"""

    source: tyro.conf.Positional[Path]
    """An episode file, .json or .json.gz."""
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """Output file, .json or .json.gz."""
    scene_dataset: Annotated[str, tyro.conf.arg(metavar="NAME|PATH")] = "apartment"
    """Scene dataset of the episodes: `apartment` (included), or a ReplicaCAD folder."""
    objects: Annotated[str | None, tyro.conf.arg(metavar="PATH")] = None
    """A YCB folder, instead of the included objects."""
    env: Annotated[str | None, tyro.conf.arg(metavar="ID")] = None
    """Environment of Habitat's episodes, instead of the task inferred from their receptacles."""
    force: bool = False
    """Replace FILE."""

    def run(self) -> int:
        """Converts the file, then prints a summary."""
        from hab_authoring.habitat.convert import is_habitat
        from hab_tasks.scenes.habitat.dataset import resolve_dataset
        from hab_tasks.scenes.objects import load_objects

        check_ending(self.out)
        check_file(self.out, force=self.force)
        if self.env is not None:
            imported_id(self.env)
        dataset, objects = resolve_dataset(self.scene_dataset), load_objects(self.objects)
        convert = self._from_habitat if is_habitat(self.source) else self._to_habitat
        convert(dataset, objects)
        return 0

    def _from_habitat(self, dataset: SceneDataset, objects: Mapping[str, ObjectTemplate]) -> None:
        from hab_authoring.habitat.convert import read_habitat
        from hab_authoring.habitat.entry import START
        from hab_authoring.habitat.start import draw_starts
        from hab_tasks.episodes.schema import write_episodes

        with progress_bar("episode") as progress:
            made = read_habitat(self.source, dataset, objects, self.env, progress)
        with progress_bar("start") as progress:
            made = draw_starts(made, dataset, objects, progress)
        write_episodes(made, self.out)
        print(f"wrote {len(made)} episodes ({made.split}) for {made.env} to {self.out}")
        kept = Counter(key for e in made.episodes for key in e.habitat.get("kept", ()))
        print(f"  kept for conversion back: {_listed(kept)}")
        drawn = sum(START in e.habitat for e in made.episodes)
        print(f"  robot starts, which Habitat samples at each reset, sampled once: {drawn}")
        print("  dropped: nothing")

    def _to_habitat(self, dataset: SceneDataset, objects: Mapping[str, ObjectTemplate]) -> None:
        from hab_authoring.habitat.convert import OWN_KEY, to_habitat
        from hab_tasks.episodes.schema import read_episodes, save_json

        with progress_bar("episode") as progress:
            raw = to_habitat(read_episodes(self.source), dataset, objects, progress)
        save_json(raw, self.out, sort_keys=False)
        print(f"wrote {len(raw['episodes'])} episodes in Habitat's format to {self.out}")
        own: list[Mapping[str, Any]] = [
            (e.get("info") or {}).get(OWN_KEY, {}) for e in raw["episodes"]
        ]
        beside = Counter(key for fields in (*own, raw.get(OWN_KEY, {})) for key in fields)
        print(f"  stored under {OWN_KEY!r}, which Habitat ignores: {_listed(beside)}")
        print("  dropped: nothing")


def _listed(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{name} ({times})" for name, times in sorted(counts.items())) or "nothing"
