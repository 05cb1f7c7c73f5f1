"""`hab-tasks convert`: exchanges episode files with Habitat."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import tyro
from tqdm import tqdm

from hab_tasks.commands.base import Command, check_ending
from hab_tasks.errors import UnknownNameError
from hab_tasks.files import check_file
from hab_tasks.registration import ENTRY_POINTS

if TYPE_CHECKING:
    from hab_tasks.scenes.dataset import SceneDataset
    from hab_tasks.scenes.spec import ObjectTemplate


@dataclass(frozen=True, kw_only=True)
class Convert(Command):
    """Options of `hab-tasks convert`."""

    help: ClassVar[str] = """Turns Habitat's rearrangement episodes into ours, or back.

The file tells which way. Prints what the other format has no field for, and where it is kept.

Example:
  hab-tasks convert tidy_house.json.gz --scene-dataset ~/data/replica_cad --out tidy.json.gz"""

    source: tyro.conf.Positional[Path]
    """An episode file, .json or .json.gz."""
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """The file to write, .json or .json.gz."""
    scene_dataset: Annotated[str, tyro.conf.arg(metavar="NAME|PATH")] = "apartment"
    """The episodes' scene dataset: `apartment`, which is shipped, or a ReplicaCAD folder."""
    objects: Annotated[str | None, tyro.conf.arg(metavar="PATH")] = None
    """A YCB folder, instead of the shipped objects."""
    env: Annotated[str | None, tyro.conf.arg(metavar="ID")] = None
    """Environment of Habitat's episodes, instead of the task that their receptacles suggest."""
    force: bool = False
    """Replace FILE."""

    def run(self) -> int:
        """Converts the file, then prints what went where."""
        from hab_tasks.episodes.habitat import is_habitat
        from hab_tasks.scenes.dataset import resolve_dataset
        from hab_tasks.scenes.objects import load_objects

        check_ending(self.out)
        check_file(self.out, force=self.force)
        if self.env is not None and self.env not in ENTRY_POINTS:
            raise UnknownNameError("env", self.env, ENTRY_POINTS)
        dataset, objects = resolve_dataset(self.scene_dataset), load_objects(self.objects)
        convert = self._from_habitat if is_habitat(self.source) else self._to_habitat
        convert(dataset, objects)
        return 0

    def _from_habitat(self, dataset: SceneDataset, objects: Mapping[str, ObjectTemplate]) -> None:
        from hab_tasks.episodes.habitat import read_habitat
        from hab_tasks.episodes.habitat_entry import START
        from hab_tasks.episodes.habitat_start import draw_starts
        from hab_tasks.episodes.schema import write_episodes

        with _bar("episode") as progress:
            made = read_habitat(self.source, dataset, objects, self.env, progress)
        with _bar("start") as progress:
            made = draw_starts(made, dataset, objects, progress)
        write_episodes(made, self.out)
        print(f"wrote {len(made)} episodes ({made.split}) for {made.env} to {self.out}")
        kept = Counter(key for e in made.episodes for key in e.habitat.get("kept", ()))
        print(f"  kept for the way back: {_listed(kept)}")
        drawn = sum(START in e.habitat for e in made.episodes)
        print(f"  robot starts, which Habitat draws at each reset, drawn once: {drawn}")
        print("  dropped: nothing")

    def _to_habitat(self, dataset: SceneDataset, objects: Mapping[str, ObjectTemplate]) -> None:
        from hab_tasks.episodes.habitat import OWN_KEY, to_habitat
        from hab_tasks.episodes.schema import read_episodes, save_json

        with _bar("episode") as progress:
            raw = to_habitat(read_episodes(self.source), dataset, objects, progress)
        save_json(raw, self.out, sort_keys=False)
        print(f"wrote {len(raw['episodes'])} episodes in Habitat's format to {self.out}")
        own: list[Mapping[str, Any]] = [
            (e.get("info") or {}).get(OWN_KEY, {}) for e in raw["episodes"]
        ]
        beside = Counter(key for fields in (*own, raw.get(OWN_KEY, {})) for key in fields)
        print(f"  under {OWN_KEY!r}, which Habitat does not read: {_listed(beside)}")
        print("  dropped: nothing")


@contextmanager
def _bar(unit: str) -> Iterator[Callable[[int, int], None]]:
    with tqdm(unit=unit, disable=not sys.stderr.isatty()) as bar:

        def progress(ready: int, count: int) -> None:
            bar.total = count
            bar.update(ready - bar.n)

        yield progress


def _listed(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{name} ({times})" for name, times in sorted(counts.items())) or "nothing"
