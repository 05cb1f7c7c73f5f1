"""Generate the `apartment` dataset.

Run `python -m hab_authoring.apartment --out assets/apartment`; with `--check` it only compares.
Micro-variations (`v3_sc*_staging_01` and up) are generated elsewhere: existing ones are kept, and
`--check` ignores them.
"""

import argparse
import filecmp
import logging
import re
import shutil
import sys
import tempfile
from pathlib import Path

from hab_authoring.apartment import (
    catalogue,
    clothes,
    decor,
    layouts,
    packing,
    pickables,
    shell,
)
from hab_authoring.apartment.model import Dataset
from hab_authoring.apartment.writer import write_dataset
from hab_tasks.io.files import folder_written_aside

NAME = "apartment"
THEMES = (catalogue, clothes, decor, pickables)
VARIATION = re.compile(r"configs/scenes/v3_sc\d_staging_(?!00)\d\d\.scene_instance\.json")
logger = logging.getLogger(NAME)


def make_dataset() -> Dataset:
    """Return the whole dataset in memory."""
    objects = [item for theme in THEMES for item in theme.build()]
    feet_m = layouts.feet_m(objects)
    articulations = list(catalogue.articulated())
    macros = layouts.macros()
    flats, things = layouts.dense(macros)
    plans = {layout.plan.name: layout.plan for layout in (*macros, *flats)}
    return Dataset(
        stages=[shell.build(plan) for plan in plans.values()],
        objects=objects,
        articulations=articulations,
        lightings={layout.lighting: list(layout.lights) for layout in (*macros, *flats)},
        scenes=[
            *(layout.scene(feet_m) for layout in macros),
            *(packing.furnished(flat, things, objects, articulations) for flat in flats),
        ],
    )


def files_of(root: Path) -> set[str]:
    """Return the files below a folder, relative to it."""
    return {p.relative_to(root).as_posix() for p in root.rglob("*") if p.is_file()}


def first_difference(made: Path, kept: Path) -> str | None:
    """Return the first file, in sorted order, that is missing, extra or different in `kept`."""
    names = files_of(made) | {name for name in files_of(kept) if not VARIATION.fullmatch(name)}
    for name in sorted(names):
        if not (made / name).is_file() or not (kept / name).is_file():
            return name
        if not filecmp.cmp(made / name, kept / name, shallow=False):
            return name
    return None


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="the dataset folder")
    parser.add_argument(
        "--check", action="store_true", help="compare with --out instead of writing"
    )
    args = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    if args.check:
        with tempfile.TemporaryDirectory() as scratch:
            write_dataset(make_dataset(), NAME, Path(scratch))
            different = first_difference(Path(scratch), args.out)
        if different is not None:
            logger.error("%s differs from what the script makes", different)
            return 1
        logger.info("%s is up to date", args.out)
        return 0
    with folder_written_aside(args.out) as made:
        write_dataset(make_dataset(), NAME, made)
        for name in sorted(filter(VARIATION.fullmatch, files_of(args.out))):
            shutil.copyfile(args.out / name, made / name)
    logger.info("wrote %s", args.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
