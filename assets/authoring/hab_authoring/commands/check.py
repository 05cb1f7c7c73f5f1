"""`hab-tasks check`: the report on a dataset, trials of layouts, downloads by ManiSkill."""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from mani_skill import ASSET_DIR
from mani_skill.utils import download_asset
from tqdm import tqdm

from hab_authoring.commands.options import Check
from hab_authoring.inventory import (
    COMPLETE,
    Inventory,
    absent_objects,
    macro_layouts,
    micro_variations,
    take_inventory,
)
from hab_authoring.layouts.report import check_layouts
from hab_tasks.errors import HabError
from hab_tasks.option_values import MOST_WORKERS, whole
from hab_tasks.world.scenes.habitat.dataset import (
    MANISKILL_ASSETS,
    REPLICA_CAD_NAMES,
    SPLIT_MACROS,
    SceneDataset,
    maniskill_folder,
    resolve_dataset,
)
from hab_tasks.world.scenes.objects import load_objects
from hab_tasks.world.scenes.visuals import read_textured

EXIT_FAULTS = 1
OVERLAP = "overlap"
SHOWN = 5
PAGE_WIDTH, LABEL_WIDTH = 100, 20

Entry = tuple[str, str]
"""Label and text of an entry of the report."""


def run(options: Check) -> int:
    """Prints the report, and simulates layouts on request; returns the exit status.

    Raises:
        HabError: Conflicting options, or a damaged file.
    """
    if options.scenes is not None and not options.simulate:
        raise HabError("--scenes selects layouts for --simulate; give both.")
    whole("--workers", options.workers, 1, MOST_WORKERS)
    if options.download:
        _download(options)
    dataset = resolve_dataset(options.dataset)
    named = [name.strip() for name in (options.scenes or "").split(",") if name.strip()]
    scenes = named or sorted(dataset.scene_files)
    for scene_id in scenes:
        dataset.scene_file(scene_id)
    found = take_inventory(dataset)
    present, missing = _present(dataset, found), _missing(dataset, found)
    if options.objects is not None:
        lacking = absent_objects(options.objects)
        if lacking:
            missing.append(("YCB objects", f"{_names(lacking)} -> the folder is rejected"))
        else:
            objects = load_objects(options.objects)
            for template in objects.values():  # read those of YCB, which loading does not
                if template.visual_file is not None and template.visual_file.suffix == ".obj":
                    read_textured(template.visual_file)
            masses = {name: objects[name].mass_kg for name in sorted(objects)}
            words = ", ".join(f"{name} {mass:.3f} kg" for name, mass in masses.items())
            present.append(("YCB objects", f"{len(masses)}: {words}"))
    print(f"{dataset.name} in {dataset.root}")
    _print_part("Present", present)
    _print_part("Missing", missing or [("nothing", "complete")])
    return _simulate(options, dataset, scenes) if options.simulate else 0


def _download(options: Check) -> None:
    asked = {"ReplicaCAD": options.dataset in REPLICA_CAD_NAMES, "ycb": options.objects == "ycb"}
    if not any(asked.values()):
        raise HabError("--download needs DATASET replica_cad or --objects ycb.")
    for asset in (name for name, wanted in asked.items() if wanted):
        print(f"{asset} is in {fetch(asset)}")


def _simulate(options: Check, dataset: SceneDataset, scenes: list[str]) -> int:
    """Simulates layouts; returns the exit status."""
    kinds: Counter[str] = Counter()
    overlaps: Counter[str] = Counter()
    failed = 0
    print("\nFaults")
    trials = tqdm(
        check_layouts(dataset, scenes, min(options.workers, len(scenes))),
        total=len(scenes),
        unit="layout",
        disable=None,
    )
    for scene_id, faults in trials:
        by_kind = _by_kind(faults)
        kinds.update(by_kind.keys())
        pairs = {text.rpartition(" by ")[0] for text in by_kind.pop(OVERLAP, ())}
        overlaps.update(sorted(pairs))
        failed += bool(by_kind)
        if by_kind:
            trials.write(f"  {scene_id}  {_in_short(by_kind)}")
    if not failed:
        print("  none")
    passed = f"{len(scenes) - failed} of {len(scenes)} layouts settle and are reachable"
    tried = [("passed", passed), *((kind, f"in {n} layouts") for kind, n in kinds.items())]
    if overlaps:
        often = [f"{pair} ({count})" for pair, count in overlaps.most_common(SHOWN)]
        words = f"in {kinds[OVERLAP]} layouts, not a failure; most often {_names(often)}"
        tried = [entry for entry in tried if entry[0] != OVERLAP] + [(OVERLAP, words)]
    _print_part("Tried", tried)
    return EXIT_FAULTS if failed else 0


def _present(dataset: SceneDataset, found: Inventory) -> list[Entry]:
    splits = ", ".join(f"{name} {len(dataset.scenes_of_split(name))}" for name in SPLIT_MACROS)
    kinds = {
        "macro": len(macro_layouts(dataset)),
        "micro-variations": len(micro_variations(dataset)),
        "apt": sum(name.startswith("apt_") for name in found.layouts),
    }
    kinds["other"] = len(found.layouts) - sum(kinds.values())
    by_kind = ", ".join(f"{count} {kind}" for kind, count in kinds.items() if count)
    objects = f"{found.templates} templates in {len(found.categories)} categories"
    if found.movable:
        objects += f", and {found.movable} that tasks move"
    boxes = found.templates + found.movable - found.convex - len(found.absent_meshes)
    entries = [
        ("layouts", f"{len(found.layouts)}: {splits}; {_kinds(dataset) or by_kind}"),
        ("objects", objects),
        ("collision", f"{found.convex} templates with convex parts, {boxes} as boxes"),
        ("furniture", f"{len(found.furniture)} with joints: {', '.join(found.furniture)}"),
        ("receptacles", f"{len(found.receptacles)} names"),
        ("navmeshes", f"{found.navmeshes} of {len(found.layouts)} layouts"),
        ("stage meshes", f"{len(found.stages) - len(found.absent_stages)} of {len(found.stages)}"),
    ]
    if found.licence is not None:
        entries.append(("licence", f"{found.licence}: {_first_line(found.licence)}"))
    return entries


def _kinds(dataset: SceneDataset) -> str | None:
    """Returns a description of a folder of layouts; None for other datasets."""
    if dataset.layouts is None:
        return None
    counts = Counter(dataset.layouts.macros.values())
    kind = "wild layouts" if dataset.layouts.wild else "micro-variations"
    words = ", ".join(f"{macro} ({count})" for macro, count in sorted(counts.items()))
    return f"{kind} of {words} of {dataset.layouts.dataset}"


def _missing(dataset: SceneDataset, found: Inventory) -> list[Entry]:
    """Returns the missing parts, each with the substitute after the arrow."""
    entries = []
    if found.absent_layouts:
        count = f"{len(found.absent_layouts)} of {len(COMPLETE)}"
        entries.append(
            ("layouts", f"{count}: {_runs(found.absent_layouts)} -> the others are used")
        )
    empty = [name for name in SPLIT_MACROS if not dataset.scenes_of_split(name)]
    if empty and len(empty) < len(SPLIT_MACROS) and dataset.layouts is None:
        used = dataset.resolve_split(None)
        words = f"{', '.join(empty)} -> rejected by --split; without --split, {used} is used"
        entries.append(("splits", words))
    if found.absent_stages:
        source = "the navmesh" if found.navmeshes else "the usual extent"
        words = f"{_names(found.absent_stages)} -> floor and walls are boxes made from {source}"
        entries.append(("stage meshes", words))
    if found.absent_meshes:
        names = [f"{name} ({count or 'no'} layouts)" for name, count in found.absent_meshes.items()]
        entries.append(("object meshes", f"{_names(names)} -> skipped"))
    if found.absent_parts:
        words = f"{_names(found.absent_parts)} -> their bounding boxes collide"
        entries.append(("convex parts", words))
    if found.licence is None:
        entries.append(("licence", "no LICENSE file -> check its terms before publishing results"))
    return entries


def _print_part(title: str, entries: Iterable[Entry]) -> None:
    print(f"\n{title}")
    for label, words in entries:
        print(
            textwrap.fill(
                words,
                width=PAGE_WIDTH,
                initial_indent=f"  {label:<{LABEL_WIDTH}} ",
                subsequent_indent=" " * (LABEL_WIDTH + 3),
                break_long_words=False,
                break_on_hyphens=False,
            )
        )


def _names(names: Iterable[str]) -> str:
    return ", ".join(names)


def _runs(scene_ids: Iterable[str]) -> str:
    """Returns scene ids with consecutive runs merged: ``v3_sc3_staging_00 to 20``."""
    runs: list[list[str]] = []
    for scene_id in scene_ids:
        stem, number = scene_id.rsplit("_", 1)
        last = runs[-1][-1].rsplit("_", 1) if runs else ["", "-9"]
        if last[0] == stem and int(last[1]) + 1 == int(number):
            runs[-1].append(scene_id)
        else:
            runs.append([scene_id])
    return ", ".join(r[0] + (f" to {r[-1].rsplit('_', 1)[1]}" if r[1:] else "") for r in runs)


def _by_kind(faults: Iterable[str]) -> dict[str, list[str]]:
    """Groups faults (``kind: text``) by kind."""
    found: dict[str, list[str]] = {}
    for fault in faults:
        kind, _, text = fault.partition(": ")
        found.setdefault(kind, []).append(text)
    return found


def _in_short(by_kind: dict[str, list[str]]) -> str:
    """Returns the first fault of each kind and the number of others."""
    return "; ".join(
        f"{kind}: {texts[0]}" + (f" and {len(texts) - 1} more" if texts[1:] else "")
        for kind, texts in by_kind.items()
    )


def _first_line(file: Path) -> str:
    lines = (line.strip("# ").strip() for line in file.read_text(errors="replace").splitlines())
    return next((line for line in lines if line), "")


def fetch(asset: str) -> Path:
    """Returns the folder of a ManiSkill asset (``ReplicaCAD``, ``ycb``), downloaded if absent.

    Raises:
        HabError: The download failed, or the folder has other content.
    """
    subfolder, part = MANISKILL_ASSETS[asset]
    folder = ASSET_DIR / subfolder
    if (folder / part).is_dir():
        return folder
    if folder.is_dir() and any(folder.iterdir()):
        raise HabError(
            f"{folder}: not empty, but has no {part}/. ManiSkill would delete its content before "
            f"downloading {asset}; move it away first."
        )
    try:
        download_asset.download(download_asset.DATA_SOURCES[asset], non_interactive=True)
    except (OSError, ValueError) as error:
        raise HabError(f"{asset} could not be downloaded to {folder}: {error}") from error
    return maniskill_folder(asset)
