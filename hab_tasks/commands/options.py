"""Options of the subcommands of `hab-tasks`; each one's work is in the module of its name."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from hab_tasks.commands.keyboard import key_table, meanings
from hab_tasks.io.console import Command
from hab_tasks.io.executors import ExecutorChoice


@dataclass(frozen=True, kw_only=True)
class List(Command):
    """Options of `hab-tasks list`."""

    help: ClassVar[
        str
    ] = """Lists the environments: id, horizon, control modes, summary, observation entries.

Example:
  hab-tasks list"""
    work: ClassVar[str] = "hab_tasks.commands.episodes:list_environments"


@dataclass(frozen=True, kw_only=True)
class Demo(Command):
    """Options of `hab-tasks demo`."""

    help: ClassVar[
        str
    ] = f"""Runs one episode in a window, browser or video, and prints its measures.

Without a display no window opens; --viewer web and --out work all the same. Keys are read from the
terminal, or in the browser from buttons and keys beside the scene. A held key keeps moving, slowly
for half a second, then at full speed:
{key_table(meanings())}

Example:
  hab-tasks demo HabPick-v1 --agent random --steps 60 --out pick.mp4
  hab-tasks demo HabTidyHouse-v1 --agent keyboard --viewer web"""
    work: ClassVar[str] = "hab_tasks.commands.demo:run"

    env: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="ENV")]
    """Environment id; see `hab-tasks list`."""
    agent: Annotated[str, tyro.conf.arg(metavar="NAME")] = "random"
    """random or keyboard."""
    viewer: Annotated[str, tyro.conf.arg(metavar="NAME")] = "window"
    """window, or web: a page on the loopback interface, which needs neither a display nor a Vulkan
    device (pip install 'hab-tasks[view]')."""
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


@dataclass(frozen=True, kw_only=True)
class Episodes(ExecutorChoice, Command):
    """Options of `hab-tasks episodes`."""

    help: ClassVar[str] = """Generates an episode file; equal options give equal episodes.

Example:
  hab-tasks episodes --env HabPick-v1 --split train --count 100 --seed 0 --out pick.json.gz

On a Ray cluster, from one of its nodes:
  hab-tasks episodes --env HabPick-v1 --count 100000 --workers 64 --executor ray --address auto \\
    --out pick.json.gz"""
    work: ClassVar[str] = "hab_tasks.commands.episodes:run"

    env: Annotated[str, tyro.conf.arg(metavar="ID")]
    """Environment id; see `hab-tasks list`."""
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """Output file, .json or .json.gz."""
    split: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """train, val or test; default: the least-seen split available."""
    scene: Annotated[str | None, tyro.conf.arg(metavar="ID")] = None
    """Only this layout."""
    count: Annotated[int, tyro.conf.arg(metavar="N")] = 50
    """Number of episodes."""
    seed: Annotated[int, tyro.conf.arg(metavar="S")] = 0
    """Seed of the episodes."""
    scene_dataset: Annotated[str, tyro.conf.arg(metavar="NAME|PATH")] = "apartment"
    """`apartment` (included), or a ReplicaCAD folder."""
    objects: Annotated[str | None, tyro.conf.arg(metavar="PATH")] = None
    """A YCB folder, instead of the included objects."""
    novel: Annotated[str | None, tyro.conf.arg(metavar="WHAT")] = None
    """objects or receptacles: use those held out for evaluating generalisation."""
    workers: Annotated[int, tyro.conf.arg(metavar="W")] = 1
    """Number of worker processes; does not change the episodes."""
    force: bool = False
    """Replace FILE."""
    resume: bool = False
    """Continue an interrupted run with the same options."""

    @property
    def journal(self) -> Path:
        """Path of the journal, which exists while FILE is incomplete."""
        return self.out.with_name(f"{self.out.name}.journal")

    def advice(self) -> str:
        """Returns how to continue."""
        kept = self.journal
        return f"Use --resume to continue; episodes are kept in {kept}." if kept.exists() else ""
