"""`hab-tasks demo`: runs an environment with random actions or keyboard control."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from hab_tasks.commands.keyboard import key_table
from hab_tasks.console import Command
from hab_tasks.robots.fetch import FETCH


@dataclass(frozen=True, kw_only=True)
class Demo(Command):
    """Options of `hab-tasks demo`."""

    help: ClassVar[str] = f"""Runs one episode in a window or video, and prints its measures.

Without a display no window opens; --out still writes a video. Keys are read from the terminal. A
held key keeps moving, slowly for half a second, then at full speed (the base at
{FETCH.base_linear_speed_m_s:g} m/s):
{key_table()}

Example:
  hab-tasks demo HabPick-v1 --agent random --steps 60 --out pick.mp4
  hab-tasks demo HabTidyHouse-v1 --agent keyboard"""

    env: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="ENV")]
    """Environment id; see `hab-tasks list`."""
    agent: Annotated[str, tyro.conf.arg(metavar="NAME")] = "random"
    """random or keyboard."""
    episode: Annotated[int, tyro.conf.arg(metavar="I")] = 0
    """Index of the episode."""
    scene_dataset: Annotated[str, tyro.conf.arg(metavar="NAME|PATH")] = "apartment"
    """`apartment` (included), or a ReplicaCAD folder."""
    objects: Annotated[str | None, tyro.conf.arg(metavar="PATH")] = None
    """A YCB folder, instead of the included objects."""
    steps: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Maximum number of actions; default: 200 random ones, or the horizon with the keyboard."""
    seed: Annotated[int, tyro.conf.arg(metavar="S")] = 0
    """Seed of the random actions."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE.mp4")] = None
    """Output video."""
    force: bool = False
    """Replace FILE.mp4."""

    def run(self) -> int:
        """Runs the episode; prints a line per action, then the result."""
        from hab_tasks.commands.playing import play

        return play(self)
