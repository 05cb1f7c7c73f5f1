"""Options of the subcommands of authors; each one's work is in the module of its name."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from hab_tasks.io.console import Command


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
    work: ClassVar[str] = "hab_authoring.commands.check:run"

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
    work: ClassVar[str] = "hab_authoring.commands.vary:run"

    dataset: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="DATASET")]
    """`apartment` or a ReplicaCAD folder."""
    macro: Annotated[str | None, tyro.conf.arg(metavar="ID")] = None
    """The macro layout, v3_sc1_staging_00 or sc1 for short. With --wild, default: all of them."""
    wild: bool = False
    """Move all furniture, kitchen included, keeping tasks feasible. The layouts are split test."""
    corner: bool = False
    """With --wild: every fridge has a tall thing beside its handle, a wall or the counter."""
    shelves: bool = False
    """With --wild: the narrow shelves hang up to 0.32 m higher, at a height drawn anew."""
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


@dataclass(frozen=True, kw_only=True)
class Assets(Command):
    """Options of `hab-tasks assets`."""

    help: ClassVar[str] = """Writes an optimised copy of a dataset: less memory, faster collisions.

The printed sizes are computed from the dataset's GLB visuals, each file once, without --objects:
56 bytes per vertex, 4 per index, and 4 per texture pixel (1/2 or 1 when compressed).
`python -m hab_authoring.pipeline.measure DATASET DIR` measures the memory of a rendering process.

Example:
  hab-tasks assets ~/data/replica_cad --objects ~/data/ycb --collision coacd --out ~/data/light"""
    work: ClassVar[str] = "hab_authoring.commands.datasets:run_assets"

    dataset: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="DATASET")]
    """`apartment` or the path of a ReplicaCAD folder; left unchanged."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Output folder; use it as --scene-dataset DIR, and DIR/ycb as --objects."""
    collision: Annotated[str, tyro.conf.arg(metavar="HOW")] = "coacd"
    """coacd: at most 20 convex parts; hull: one hull per part; merged-hull: one hull; or box."""
    recompute: bool = False
    """Compute collision parts from the visual meshes even if the dataset has convex parts."""
    decimate: Annotated[float, tyro.conf.arg(metavar="F")] = 0.5
    """Share of triangles to keep; more are kept where the shape would change."""
    texture_size: Annotated[int, tyro.conf.arg(metavar="PX")] = 1024
    """Maximum texture width and height."""
    texture_format: Annotated[str, tyro.conf.arg(metavar="FORMAT")] = "ktx2"
    """ktx2: GPU-compressed, for SAPIEN; png: readable by any program."""
    objects: Annotated[Path | None, tyro.conf.arg(metavar="PATH")] = None
    """A YCB folder, copied to DIR/ycb."""
    workers: Annotated[int, tyro.conf.arg(metavar="W")] = os.cpu_count() or 1
    """Number of worker processes."""
    force: bool = False
    """Replace the dataset at DIR."""


@dataclass(frozen=True, kw_only=True)
class Figures(Command):
    """Options of `hab-tasks figures`."""

    help: ClassVar[
        str
    ] = """Draws a dataset's furniture, categories and layouts, and statistics of episode files.

Example:
  hab-tasks figures apartment --out docs/figures --episodes tidy.json.gz table.json.gz"""
    work: ClassVar[str] = "hab_authoring.commands.datasets:run_figures"

    dataset: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="DATASET")]
    """`apartment`, `replica_cad` as ManiSkill downloads it, or the path of a ReplicaCAD folder."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Output folder of the PNG files; created if absent."""
    episodes: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="FILE ...")] = ()
    """Episode files to draw, one per environment."""
    force: bool = False
    """Replace files in DIR."""


@dataclass(frozen=True, kw_only=True)
class Convert(Command):
    """Options of `hab-tasks convert`."""

    help: ClassVar[str] = """Converts rearrangement episodes from Habitat's format, or to it.

The direction follows from the file. Prints the fields that the other format lacks, and where they
are kept.

Example:
  hab-tasks convert tidy_house.json.gz --scene-dataset ~/data/replica_cad --out tidy.json.gz"""
    work: ClassVar[str] = "hab_authoring.commands.datasets:run_convert"

    source: tyro.conf.Positional[Path]
    """An episode file, .json or .json.gz."""
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """Output file, .json or .json.gz."""
    scene_dataset: Annotated[str, tyro.conf.arg(metavar="NAME|PATH")] = "apartment"
    """Scene dataset of the episodes: `apartment` (included), or a ReplicaCAD folder."""
    objects: Annotated[str | None, tyro.conf.arg(metavar="PATH")] = None
    """A YCB folder, instead of the included objects."""
    env: Annotated[str | None, tyro.conf.arg(metavar="ID")] = None
    """Environment of Habitat's episodes, instead of the task inferred from their receptacles."""
    force: bool = False
    """Replace FILE."""


@dataclass(frozen=True, kw_only=True)
class Docs(Command):
    """Options of `hab-tasks docs`."""

    help: ClassVar[
        str
    ] = """Writes environments.md (spaces, rewards and termination of every environment), and
contract.md (every entry of observations and actions) with a recorded episode.

Example:
  hab-tasks docs --out docs --pictures --force"""
    work: ClassVar[str] = "hab_authoring.commands.docs:run"

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Output folder; created if absent."""
    pictures: bool = False
    """Also draw the frames, and env_<id>.png of each: the scene beside the head camera's view."""
    force: bool = False
    """Replace files in DIR."""
