"""`hab-tasks vary`: generates micro-variations of a macro layout, or wild layouts."""

from __future__ import annotations

import statistics
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import tyro
from tqdm import tqdm

from hab_tasks.console import Command
from hab_tasks.errors import HabError
from hab_tasks.files import check_folder, folder_written_aside
from hab_tasks.option_values import LARGEST_SEED, whole

if TYPE_CHECKING:
    from hab_authoring.layouts.wild import WildLayout
    from hab_tasks.scenes.habitat.dataset import SceneDataset
    from hab_tasks.scenes.habitat.layout_set import LayoutSet

WILD_SPLIT = "test"
MOST_LAYOUTS = 100_000
DOOR_BINS_RAD = (1.6, 1.8, 2.0, 2.29)
"""Histogram bins of the maximum opening of the fridge's door, whose limit is 2.3 rad."""

Made = tuple[str, str, dict[str, Any], Counter[str]]
"""Scene id, macro layout, scene_instance file, rejections by reason."""


@dataclass(frozen=True, kw_only=True)
class Vary(Command):
    """Options of `hab-tasks vary`."""

    help: ClassVar[str] = """Generates validated layouts of a dataset's furniture, as a dataset.

At least two pieces of furniture swap positions and some others move slightly. With --wild,
furniture and kitchen are placed anywhere along the walls, with blocked fridge doors and narrow
aisles.
Equal options give equal layouts, and layout 7 does not depend on the number of layouts.
With --extend train, DIR is DATASET with more training layouts.
DIR is accepted wherever a dataset is; it refers to the dataset that has the furniture.

Example:
  hab-tasks vary apartment --macro sc1 --count 20 --seed 0 --out my_layouts
  hab-tasks vary apartment --wild --count 100 --out wild
  hab-tasks vary apartment --wild --extend train --count 100 --out larger
  hab-eval run --agent hab_spa:spa_priv --env HabPick-v1 --scene-dataset wild --out runs/wild"""

    dataset: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="DATASET")]
    """`apartment` or a ReplicaCAD folder."""
    macro: Annotated[str | None, tyro.conf.arg(metavar="ID")] = None
    """The macro layout, v3_sc1_staging_00 or sc1 for short. With --wild, default: all of them."""
    wild: bool = False
    """Move all furniture, kitchen included, keeping tasks feasible. The layouts are split test."""
    extend: Annotated[str | None, tyro.conf.arg(metavar="SPLIT")] = None
    """With --wild: sample from the macro layouts of train, val or test, and add the layouts to this
    split of DATASET, whose own layouts DIR then has too."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Output folder of the *.scene_instance.json files and layouts.json."""
    count: Annotated[int, tyro.conf.arg(metavar="N")] = 20
    """Number of layouts."""
    seed: Annotated[int, tyro.conf.arg(metavar="S")] = 0
    """Seed of the layouts."""
    force: bool = False
    """Replace the layouts in DIR."""

    def run(self) -> int:
        """Generates and writes the layouts, then prints the rejections by reason."""
        from hab_authoring.inventory import macros_of_split
        from hab_authoring.layouts.vary import macro_scene_id
        from hab_tasks.scenes.habitat.dataset import resolve_dataset
        from hab_tasks.scenes.habitat.layout_set import FILE

        self._check()
        dataset = resolve_dataset(self.dataset)
        if dataset.layouts is not None:
            raise HabError(
                f"{self.dataset} already consists of variations; vary {dataset.layouts.dataset}."
            )
        macro = None if self.macro is None else macro_scene_id(dataset, self.macro)
        macros = None if macro is None else [macro]
        if self.extend is not None:
            macros = macros_of_split(dataset, self.extend)
        check_folder(self.out, force=self.force, mark=FILE)
        wild: list[WildLayout] = []
        if macro is None or self.wild:
            made = self._wild(dataset, macros, wild)
        else:
            made = self._ordinary(dataset, macro)
        refused = self._write(dataset, macro, made)
        kind = "wild layouts" if self.wild else "layouts"
        print(f"wrote {self.count} {kind} of {macro or dataset.name} to {self.out}")
        for line in _about(wild):
            print(f"  {line}")
        for reason, times in sorted(refused.items()):
            print(f"  rejected {times}: {reason}")
        return 0

    def _check(self) -> None:
        whole("--count", self.count, 1, MOST_LAYOUTS)
        whole("--seed", self.seed, 0, LARGEST_SEED)
        if self.macro is None and not self.wild:
            raise HabError(
                "No layout to vary: give --macro, for example --macro sc1, or --wild to sample "
                "from all layouts."
            )
        if self.extend is not None and (self.macro is not None or not self.wild):
            raise HabError("--extend samples wild layouts of a split: give --wild and no --macro.")

    def _write(
        self, dataset: SceneDataset, macro: str | None, made: Iterator[Made]
    ) -> Counter[str]:
        """Writes layouts as they are generated; returns the rejections by reason."""
        from hab_authoring.layouts.write import write_scene
        from hab_tasks.scenes.habitat.layout_set import write_layout_set

        macros: dict[str, str] = {}
        refused: Counter[str] = Counter()
        bar = tqdm(made, total=self.count, unit="layout", disable=None)
        with folder_written_aside(self.out) as folder:
            for scene_id, source, scene, reasons in bar:
                write_scene(scene, folder, scene_id)
                macros[scene_id] = source
                refused += reasons
            write_layout_set(self._layout_set(dataset, macro, macros), folder)
        return refused

    def _ordinary(self, dataset: SceneDataset, macro: str) -> Iterator[Made]:
        from hab_authoring.layouts.vary import LayoutVarier

        varier = LayoutVarier(dataset, macro)
        stem = macro.removesuffix("_00")
        for index in range(1, self.count + 1):
            variation = varier.make(self.seed, index)
            yield f"{stem}_{index:02d}", macro, variation.scene, variation.rejections

    def _wild(
        self, dataset: SceneDataset, macros: list[str] | None, found: list[WildLayout]
    ) -> Iterator[Made]:
        from hab_authoring.layouts.wild import WildVarier

        varier = WildVarier(dataset, macros)
        for index in range(1, self.count + 1):
            layout = varier.make(self.seed, index)
            found.append(layout)
            scene_id = f"wild_{index:03d}_{_short(layout.macro)}"
            yield scene_id, layout.macro, layout.scene, layout.rejections

    def _layout_set(
        self, dataset: SceneDataset, macro: str | None, macros: dict[str, str]
    ) -> LayoutSet:
        from hab_tasks.scenes.habitat.dataset import embedded_dataset
        from hab_tasks.scenes.habitat.layout_set import LayoutSet

        embedded = dataset.root == embedded_dataset().resolve()
        parts = [
            dataset.name,
            *(["wild"] if self.wild else []),
            *([_short(macro)] if macro else []),
            *([self.extend] if self.extend else []),
        ]
        split = WILD_SPLIT if self.wild else dataset.split_of(next(iter(macros.values())))
        return LayoutSet(
            name="_".join([*parts, str(self.seed)]),
            dataset="apartment" if embedded else str(dataset.root),
            templates=dataset.templates,
            split=self.extend or split,
            wild=self.wild,
            macros=macros,
            extends=self.extend is not None,
        )


def _short(macro: str) -> str:
    """Returns ``sc1`` for ``v3_sc1_staging_00``."""
    return macro.split("_")[1]


def _about(layouts: list[WildLayout]) -> Iterator[str]:
    """Yields lines of statistics of wild layouts."""
    from hab_authoring.layouts.wild import MIRRORED

    if not layouts:
        return
    angles = [layout.door_rad for layout in layouts]
    for low, high in pairwise(DOOR_BINS_RAD):
        count = sum(low <= angle < high for angle in angles)
        yield f"{count}: fridge door blocked at {low:g} to {min(high, 2.3):g} rad"
    yield f"{sum(a >= DOOR_BINS_RAD[-1] for a in angles)}: it opens all the way"
    mirrored = sum(layout.fridge == MIRRORED for layout in layouts)
    yield f"{mirrored}: its hinges are on the other side"
    widths = sorted(layout.aisle_m for layout in layouts)
    middle = statistics.median(widths)
    yield f"narrowest aisle {widths[0]:.2f} to {widths[-1]:.2f} m, in the middle {middle:.2f} m"
