"""Author the `apartment` dataset.

Run `python assets/tools/apartment --out assets/apartment`; with `--check` it compares instead.
"""

import argparse
import filecmp
import logging
import shutil
import sys
import tempfile
from pathlib import Path

import appliances
import bikes
import books
import clothes
import cupboards
import decor
import fridge
import kitchen
import layout
import pickables
import seating
import shell
import shoes
import storage
import tables
import tableware
import utensils
from model import Dataset
from writer import write_dataset

NAME = "apartment"
THEMES = (
    appliances,
    bikes,
    books,
    clothes,
    decor,
    pickables,
    seating,
    shoes,
    storage,
    tables,
    tableware,
    utensils,
)
logger = logging.getLogger(NAME)


def make_dataset() -> Dataset:
    """Return the whole dataset in memory."""
    return Dataset(
        stages=[shell.build(layout.STAGE)],
        objects=[item for theme in THEMES for item in theme.build()],
        articulations=[
            fridge.build(),
            kitchen.build(),
            cupboards.wall_cupboard(),
            cupboards.room_door(),
            cupboards.sliding_cabinet(),
            cupboards.drawer_chest(),
        ],
        lightings=layout.LIGHTINGS,
        scenes=layout.SCENES,
    )


def first_difference(made: Path, kept: Path) -> str | None:
    """Return the first file, in sorted order, that is missing, extra or different in `kept`."""
    names = {
        p.relative_to(root).as_posix()
        for root in (made, kept)
        for p in root.rglob("*")
        if p.is_file()
    }
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
    args.out.parent.mkdir(parents=True, exist_ok=True)
    place = None if args.check else args.out.resolve().parent
    with tempfile.TemporaryDirectory(prefix=".apartment_", dir=place) as scratch:
        made = Path(scratch) / NAME
        write_dataset(make_dataset(), NAME, made)
        if args.check:
            different = first_difference(made, args.out)
            if different is not None:
                logger.error("%s differs from what the script makes", different)
                return 1
            logger.info("%s is up to date", args.out)
            return 0
        # The old folder goes only once the new one is complete.
        if args.out.exists():
            shutil.rmtree(args.out)
        made.rename(args.out)
    logger.info("wrote %s", args.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
