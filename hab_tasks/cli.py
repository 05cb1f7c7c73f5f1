"""The console script `hab-tasks`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from hab_tasks.errors import HabError
from hab_tasks.options import check_options

EXIT_BAD_INPUT = 2

LIST_HELP = """Lists the environments: id, longest episode, control modes, observation entries.

Example:
  hab-tasks list"""

CHECK_HELP = """Reads every layout and object of a dataset; tells what is there and what is missing.

Example:
  hab-tasks check ~/data/replica_cad --objects ~/data/ycb"""

EPISODES_HELP = """Makes an episode file; the same options always give the same episodes.

Example:
  hab-tasks episodes --env HabPick-v1 --split train --count 100 --seed 0 --out pick.json.gz"""


@dataclass(frozen=True, kw_only=True)
class ListCommand:
    """Options of `hab-tasks list`."""


@dataclass(frozen=True, kw_only=True)
class CheckCommand:
    """Options of `hab-tasks check`."""

    dataset: tyro.conf.Positional[str]
    """`apartment` or the path of a ReplicaCAD folder."""
    objects: Annotated[str | None, tyro.conf.arg(metavar="PATH")] = None
    """A YCB folder to check as well."""


@dataclass(frozen=True, kw_only=True)
class EpisodesCommand:
    """Options of `hab-tasks episodes`."""

    env: Annotated[str, tyro.conf.arg(metavar="ID")]
    """Environment id; `hab-tasks list` shows all."""
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """The episode file, .json or .json.gz."""
    split: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """train, val or test, instead of the most unseen one that the dataset has."""
    scene: Annotated[str | None, tyro.conf.arg(metavar="ID")] = None
    """Only this layout."""
    count: Annotated[int, tyro.conf.arg(metavar="N")] = 50
    """Number of episodes."""
    seed: Annotated[int, tyro.conf.arg(metavar="S")] = 0
    """Seed of the episodes."""
    scene_dataset: Annotated[str, tyro.conf.arg(metavar="NAME|PATH")] = "apartment"
    """`apartment`, which is shipped, or a ReplicaCAD folder."""
    objects: Annotated[str | None, tyro.conf.arg(metavar="PATH")] = None
    """A YCB folder, instead of the shipped objects."""
    force: bool = False
    """Replace FILE."""


Command = (
    Annotated[ListCommand, tyro.conf.subcommand("list", description=LIST_HELP)]
    | Annotated[CheckCommand, tyro.conf.subcommand("check", description=CHECK_HELP)]
    | Annotated[EpisodesCommand, tyro.conf.subcommand("episodes", description=EPISODES_HELP)]
)

COMMANDS = {"list": ListCommand, "check": CheckCommand, "episodes": EpisodesCommand}


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs `hab-tasks`; returns its exit status."""
    arguments = sys.argv[1:] if arguments is None else arguments
    try:
        check_options("hab-tasks", COMMANDS, arguments)
        command = tyro.cli(
            Command,  # pyright: ignore[reportArgumentType]  # tyro takes unions, its stub does not
            prog="hab-tasks",
            description="Environments, datasets and episodes of hab-tasks.",
            args=arguments,
            config=(tyro.conf.FlagCreatePairsOff,),
        )
        if isinstance(command, CheckCommand):
            return _check(command)
        return _episodes(command) if isinstance(command, EpisodesCommand) else _list()
    except HabError as error:
        print(f"hab-tasks: {' '.join(str(error).split())}", file=sys.stderr)
        return EXIT_BAD_INPUT


def _list() -> int:
    """Prints the table of environments."""
    from hab_tasks.envs import ENVS

    for entry in ENVS.values():
        skill = entry.env.skill
        print(f"{entry.id}: {entry.horizon_steps} steps; control {', '.join(skill.control_modes)}")
        for item in skill.observation:
            shape = "x".join(map(str, item.shape))
            print(f"  {item.name:<20} {shape:>4}  {item.unit:<7} {item.meaning}")
    return 0


def _check(command: CheckCommand) -> int:
    """Prints one page about a dataset; a damaged file ends it with status 2."""
    from hab_tasks.scenes.dataset import SPLIT_MACROS, resolve_dataset
    from hab_tasks.scenes.load import load_scene
    from hab_tasks.scenes.objects import load_objects

    dataset = resolve_dataset(command.dataset)
    specs = [load_scene(dataset, scene_id) for scene_id in sorted(dataset.scene_files)]
    missing = sorted({name for spec in specs for name in spec.missing})
    no_stage = sorted({s.stage.name for s in specs if s.stage.visual_file is None})
    receptacles = len({r.name for spec in specs for r in spec.receptacles})
    print(f"{dataset.name} in {dataset.root}")
    print(f"  layouts        {len(specs)}: " + ", ".join(
        f"{split} {len(dataset.scenes_of_split(split))}" for split in SPLIT_MACROS
    ))  # fmt: skip
    print(f"  templates      {len(dataset.object_files)} objects, {len(dataset.urdf_files)} URDFs")
    print(f"  receptacles    {receptacles} names")
    print(f"  stage meshes   {_absent(no_stage, 'a shell of floor and outer walls stands in')}")
    print(f"  object meshes  {_absent(missing, 'skipped in every layout')}")
    if command.objects is not None:
        objects = load_objects(command.objects)
        masses = ", ".join(f"{name} {o.mass_kg:.3f} kg" for name, o in sorted(objects.items()))
        print(f"  movable        {len(objects)} objects: {masses}")
    return 0


def _absent(names: list[str], remedy: str) -> str:
    return f"absent: {', '.join(names)} ({remedy})" if names else "all there"


def _episodes(command: EpisodesCommand) -> int:
    """Generates and writes an episode file, then prints what was refused and why."""
    from tqdm import tqdm

    from hab_tasks.envs import ENVS
    from hab_tasks.episodes import open_source
    from hab_tasks.errors import UnknownNameError

    if command.env not in ENVS:
        raise UnknownNameError("env", command.env, ENVS)
    if command.count < 1:
        raise HabError(f"--count {command.count}: at least 1 episode.")
    if command.out.exists() and not command.force:
        raise HabError(f"{command.out} exists; give --force to replace it.")
    source = open_source(
        env_id=command.env,
        scene_dataset=command.scene_dataset,
        objects=command.objects,
        split=command.split,
        scene_id=command.scene,
        seed=command.seed,
    )
    for index in tqdm(range(command.count), unit="episode", disable=not sys.stderr.isatty()):
        source.get(index)
    try:
        source.save(command.count, command.out)
    except OSError as error:
        raise HabError(f"{command.out}: cannot be written ({error}).") from error
    print(f"wrote {command.count} episodes ({source.split}) to {command.out}")
    for reason, times in sorted(source.rejections.items()):
        print(f"  refused {times}: {reason}")
    return 0
