"""`hab-tasks check`: one page about a dataset, and on request a trial of every layout."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import tyro

from hab_tasks.commands.base import Command


@dataclass(frozen=True, kw_only=True)
class Check(Command):
    """Options of `hab-tasks check`."""

    help: ClassVar[
        str
    ] = """Tells on one page what a dataset holds, what is missing, and what is done about it.

Reads every file, and stops at the first that is damaged.

Example:
  hab-tasks check ~/data/replica_cad --objects ~/data/ycb
  hab-tasks check replica_cad --objects ycb --download
  hab-tasks check apartment --simulate"""

    dataset: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="DATASET")]
    """`apartment`, `replica_cad` as ManiSkill downloads it, or the path of a ReplicaCAD folder."""
    objects: Annotated[str | None, tyro.conf.arg(metavar="ycb|PATH")] = None
    """YCB objects to check as well: `ycb` as ManiSkill downloads them, or a folder."""
    simulate: bool = False
    """Try every layout: it must settle, open and be within reach. Exit status 1 if one fails."""
    scenes: Annotated[str | None, tyro.conf.arg(metavar="A,B")] = None
    """Try only these layouts."""
    workers: Annotated[int, tyro.conf.arg(metavar="N")] = 2
    """Processes that try layouts."""
    download: bool = False
    """Let ManiSkill's own command download `replica_cad` and `ycb` where they are absent."""

    def run(self) -> int:
        """Prints the page; a damaged file raises."""
        from hab_tasks.commands.dataset_check import check_dataset

        return check_dataset(self)
