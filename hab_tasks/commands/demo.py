"""`hab-tasks demo`: shows an environment, moved by chance or by hand."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from hab_tasks.commands.base import Command
from hab_tasks.commands.keyboard import key_table
from hab_tasks.robots.fetch_spec import BASE_LINEAR_SPEED_M_S


@dataclass(frozen=True, kw_only=True)
class Demo(Command):
    """Options of `hab-tasks demo`."""

    help: ClassVar[str] = f"""Plays one episode in a window or into a video, and tells its measures.

Without a display nothing is shown; --out writes a video all the same. Keys are typed in the
terminal; one that is held moves on, slowly for half a second, then at full speed (the base at
{BASE_LINEAR_SPEED_M_S:g} m/s):
{key_table()}

Example:
  hab-tasks demo HabPick-v1 --agent random --steps 60 --out pick.mp4
  hab-tasks demo HabTidyHouse-v1 --agent keyboard"""

    env: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="ENV")]
    """Environment id; `hab-tasks list` shows all."""
    agent: Annotated[str, tyro.conf.arg(metavar="NAME")] = "random"
    """random or keyboard."""
    episode: Annotated[int, tyro.conf.arg(metavar="I")] = 0
    """Number of the episode."""
    scene_dataset: Annotated[str, tyro.conf.arg(metavar="NAME|PATH")] = "apartment"
    """`apartment`, which is shipped, or a ReplicaCAD folder."""
    objects: Annotated[str | None, tyro.conf.arg(metavar="PATH")] = None
    """A YCB folder, instead of the shipped objects."""
    steps: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Actions at most; without it 200 random ones, and as many by hand as the episode has."""
    seed: Annotated[int, tyro.conf.arg(metavar="S")] = 0
    """Seed of the random actions."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE.mp4")] = None
    """A video to write."""
    force: bool = False
    """Replace FILE.mp4."""

    def run(self) -> int:
        """Plays the episode; prints a line for each action, then how it ended."""
        from hab_tasks.commands.playing import play

        return play(self)
