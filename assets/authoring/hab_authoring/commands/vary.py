"""`hab-tasks vary`: generates micro-variations of a macro layout, or wild layouts."""

from __future__ import annotations

import statistics
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

from tqdm import tqdm

from hab_authoring.commands.options import Vary
from hab_authoring.inventory import macros_of_split
from hab_authoring.layouts.vary import LayoutVarier, macro_scene_id
from hab_authoring.layouts.wild import (
    HANDLES_IN_CORNERS,
    MIRRORED,
    SPACING_M,
    WildConfig,
    WildLayout,
    WildVarier,
)
from hab_authoring.layouts.write import write_layout_set, write_scene
from hab_tasks.errors import HabError
from hab_tasks.io.files import check_folder, folder_written_aside
from hab_tasks.option_values import LARGEST_SEED, whole
from hab_tasks.world.scenes.habitat.dataset import (
    LAYOUTS_FILE,
    LayoutSet,
    SceneDataset,
    embedded_dataset,
    resolve_dataset,
)

WILD_SPLIT = "test"
MOST_LAYOUTS = 100_000
DOOR_BINS_RAD = (1.6, 1.8, 2.0, 2.29)
"""Histogram bins of the maximum opening of the fridge's door, whose limit is 2.3 rad."""

Made = tuple[str, str, dict[str, Any], Counter[str]]
"""Scene id, macro layout, scene_instance file, rejections by reason."""


def run(options: Vary) -> int:
    """Generates and writes the layouts, then prints the rejections by reason."""
    _check(options)
    dataset = resolve_dataset(options.dataset)
    if dataset.layouts is not None:
        raise HabError(
            f"{options.dataset} already consists of variations; vary {dataset.layouts.dataset}."
        )
    macro = None if options.macro is None else macro_scene_id(dataset, options.macro)
    macros = None if macro is None else [macro]
    if options.extend is not None:
        macros = macros_of_split(dataset, options.extend)
    check_folder(options.out, force=options.force, mark=LAYOUTS_FILE)
    wild: list[WildLayout] = []
    if macro is None or options.wild:
        made = _wild(options, dataset, macros, wild)
    else:
        made = _ordinary(options, dataset, macro)
    refused = _write(options, dataset, macro, made)
    kind = "wild layouts" if options.wild else "layouts"
    print(f"wrote {options.count} {kind} of {macro or dataset.name} to {options.out}")
    for line in _about(wild):
        print(f"  {line}")
    for reason, times in sorted(refused.items()):
        print(f"  rejected {times}: {reason}")
    return 0


def _check(options: Vary) -> None:
    whole("--count", options.count, 1, MOST_LAYOUTS)
    whole("--seed", options.seed, 0, LARGEST_SEED)
    if options.macro is None and not options.wild:
        raise HabError(
            "No layout to vary: give --macro, for example --macro sc1, or --wild to sample "
            "from all layouts."
        )
    if options.extend is not None and (options.macro is not None or not options.wild):
        raise HabError("--extend samples wild layouts of a split: give --wild and no --macro.")
    if options.corner and not options.wild:
        raise HabError("--corner puts fridges of wild layouts into corners: give --wild too.")
    if options.shelves and not options.wild:
        raise HabError("--shelves raises the shelves of wild layouts: give --wild too.")


def _write(
    options: Vary, dataset: SceneDataset, macro: str | None, made: Iterator[Made]
) -> Counter[str]:
    """Writes layouts as they are generated; returns the rejections by reason."""
    macros: dict[str, str] = {}
    refused: Counter[str] = Counter()
    bar = tqdm(made, total=options.count, unit="layout", disable=None)
    with folder_written_aside(options.out) as folder:
        for scene_id, source, scene, reasons in bar:
            write_scene(scene, folder, scene_id)
            macros[scene_id] = source
            refused += reasons
        write_layout_set(_layout_set(options, dataset, macro, macros), folder)
    return refused


def _ordinary(options: Vary, dataset: SceneDataset, macro: str) -> Iterator[Made]:
    varier = LayoutVarier(dataset, macro)
    stem = macro.removesuffix("_00")
    for index in range(1, options.count + 1):
        variation = varier.make(options.seed, index)
        yield f"{stem}_{index:02d}", macro, variation.scene, variation.rejections


def _wild(
    options: Vary, dataset: SceneDataset, macros: list[str] | None, found: list[WildLayout]
) -> Iterator[Made]:
    config = HANDLES_IN_CORNERS if options.corner else WildConfig()
    if options.shelves:
        config = replace(config, shelves_m=SPACING_M)
    varier = WildVarier(dataset, macros, config)
    for index in range(1, options.count + 1):
        layout = varier.make(options.seed, index)
        found.append(layout)
        scene_id = f"wild_{index:03d}_{_short(layout.macro)}"
        yield scene_id, layout.macro, layout.scene, layout.rejections


def _layout_set(
    options: Vary, dataset: SceneDataset, macro: str | None, macros: dict[str, str]
) -> LayoutSet:
    embedded = dataset.root == embedded_dataset().resolve()
    parts = [
        dataset.name,
        *(["wild"] if options.wild else []),
        *(["corner"] if options.corner else []),
        *(["shelves"] if options.shelves else []),
        *([_short(macro)] if macro else []),
        *([options.extend] if options.extend else []),
    ]
    split = WILD_SPLIT if options.wild else dataset.split_of(next(iter(macros.values()))) or "test"
    return LayoutSet(
        name="_".join([*parts, str(options.seed)]),
        dataset="apartment" if embedded else str(dataset.root),
        templates=dataset.templates,
        split=options.extend or split,
        wild=options.wild,
        macros=macros,
        extends=options.extend is not None,
    )


def _short(macro: str) -> str:
    """Returns ``sc1`` for ``v3_sc1_staging_00``."""
    return macro.split("_")[1]


def _about(layouts: list[WildLayout]) -> Iterator[str]:
    """Yields lines of statistics of wild layouts."""
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
