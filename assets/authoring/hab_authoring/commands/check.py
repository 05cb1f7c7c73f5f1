"""`hab-tasks check`: report on a dataset, with an optional simulation of every layout."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import tyro

from hab_tasks.console import Command


@dataclass(frozen=True, kw_only=True)
class Check(Command):
    """Options of `hab-tasks check`."""

    help: ClassVar[
        str
    ] = """Reports the contents of a dataset, missing files, and their substitutes.

Reads every file, and stops at the first damaged one.

Example:
  hab-tasks check ~/data/replica_cad --objects ~/data/ycb
  hab-tasks check replica_cad --objects ycb --download
  hab-tasks check apartment --simulate"""

    dataset: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="DATASET")]
    """`apartment`, `replica_cad` as ManiSkill downloads it, or the path of a ReplicaCAD folder."""
    objects: Annotated[str | None, tyro.conf.arg(metavar="ycb|PATH")] = None
    """YCB objects to check as well: `ycb` as ManiSkill downloads them, or a folder."""
    simulate: bool = False
    """Simulate every layout: it must settle, open and be reachable. Exit status 1 on failure."""
    scenes: Annotated[str | None, tyro.conf.arg(metavar="A,B")] = None
    """Simulate only these layouts."""
    workers: Annotated[int, tyro.conf.arg(metavar="N")] = 2
    """Number of processes that simulate layouts."""
    download: bool = False
    """Download `replica_cad` and `ycb` with ManiSkill if absent."""

    def run(self) -> int:
        """Prints the report; raises on a damaged file."""
        from hab_authoring.commands.dataset_check import check_dataset

        return check_dataset(self)
