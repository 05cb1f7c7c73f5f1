"""`hab-tasks vary`: makes micro-variations of a macro layout."""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro
from tqdm import tqdm

from hab_tasks.commands.base import Command, refuse_existing
from hab_tasks.errors import HabError
from hab_tasks.scenes.dataset import resolve_dataset
from hab_tasks.scenes.vary import LayoutVarier
from hab_tasks.scenes.write import write_scene


@dataclass(frozen=True, kw_only=True)
class Vary(Command):
    """Options of `hab-tasks vary`."""

    help: ClassVar[str] = """Makes micro-variations of a macro layout, each checked, as scene files.

At least two pieces of furniture change places and some of the others move a little. The same
options always give the same layouts, and number 7 is the same whether 10 or 100 are made.

Example:
  hab-tasks vary apartment --macro sc1 --count 20 --seed 0 --out my_layouts"""

    dataset: tyro.conf.Positional[str]
    """`apartment` or a ReplicaCAD folder."""
    macro: Annotated[str, tyro.conf.arg(metavar="ID")]
    """The macro layout, v3_sc1_staging_00 or short sc1."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Folder for the *.scene_instance.json files."""
    count: Annotated[int, tyro.conf.arg(metavar="N")] = 20
    """Number of layouts."""
    seed: Annotated[int, tyro.conf.arg(metavar="S")] = 0
    """Seed of the layouts."""
    force: bool = False
    """Replace files in DIR."""

    def run(self) -> int:
        """Makes and writes the layouts, then prints what was refused on the way and why."""
        if self.count < 1:
            raise HabError(f"--count {self.count}: at least 1 layout.")
        refuse_existing(self.out, self.force)
        varier = LayoutVarier(resolve_dataset(self.dataset), self.macro)
        stem = varier.scene_id.removesuffix("_00")
        rejections: Counter[str] = Counter()
        for index in tqdm(range(1, self.count + 1), unit="layout", disable=not sys.stderr.isatty()):
            variation = varier.make(self.seed, index)
            rejections += variation.rejections
            try:
                write_scene(variation.scene, self.out, f"{stem}_{index:02d}")
            except OSError as error:
                raise HabError(f"{self.out}: cannot be written ({error}).") from error
        print(f"wrote {self.count} layouts of {varier.scene_id} to {self.out}")
        for reason, times in sorted(rejections.items()):
            print(f"  refused {times}: {reason}")
        return 0
