"""The console script `hab-spa`, and `hab-tasks publish`: options of the commands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro
from hab_eval.commands.options import EpisodeOptions

from hab_tasks.io.console import Command, run_script
from hab_tasks.io.executors import ExecutorChoice

RECORD_HELP = """Records the successful episodes of an agent as a ManiSkill trajectory.

Example:
  hab-spa record --agent hab_spa:spa_priv --env HabPick-v1 --count 10 --out runs/demonstrations
  python -m mani_skill.trajectory.replay_trajectory --traj-path runs/demonstrations/trajectory.h5

Images and the instruction of each stage, for LeRobot; colour needs a Vulkan device:
  hab-spa record --agent hab_spa:spa_priv --env HabPick-v1 --count 100 --workers 2 --lerobot \\
    --obs-mode rgb+depth --camera-size 224 --cameras head,arm --out runs/images

On a Ray cluster, from one of its nodes, with the same content:
  hab-spa record --agent hab_spa:spa_priv --env HabPick-v1 --count 1000 --workers 64 \\
    --executor ray --address auto --out runs/demonstrations

Works with any agent, including your own. Runs episodes in order until enough have succeeded."""


@dataclass(frozen=True, kw_only=True)
class RecordCommand(EpisodeOptions, ExecutorChoice, Command):
    """Options of `hab-spa record`."""

    help: ClassVar[str] = RECORD_HELP
    work: ClassVar[str] = "hab_spa.recording.record:run"

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Output folder for trajectory.h5 and trajectory.json."""
    split: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = "train"
    """Episode split; the other splits are for evaluation."""
    count: Annotated[int, tyro.conf.arg(metavar="N")] = 10
    """Number of demonstrations."""
    most: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Maximum number of episodes; ten per demonstration if not given."""
    workers: Annotated[int, tyro.conf.arg(metavar="W")] = 1
    """Number of worker processes; does not change the recording."""
    lerobot: bool = False
    """Also write a LeRobot dataset (v3.0) to DIR/lerobot; requires pyarrow."""
    obs_mode: Annotated[str | None, tyro.conf.arg(metavar="MODE")] = None
    """Images of the LeRobot dataset: rgb, depth or rgb+depth; those that the agent observes if not
    given."""
    cameras: Annotated[str | None, tyro.conf.arg(metavar="A,B")] = None
    """With --obs-mode: cameras, e.g. head,arm,third_person; those of the environment if not
    given."""
    camera_size: Annotated[int, tyro.conf.arg(metavar="PX")] = 224
    """With --obs-mode: width and height of the images."""
    targets: Annotated[str, tyro.conf.arg(metavar="HOW")] = "positions"
    """With --lerobot: `positions` of targets are observation.environment_state; with `language`,
    only the instruction tells the goal."""
    instructions: Annotated[str, tyro.conf.arg(metavar="HOW")] = "fixed"
    """Wording of the instructions: `fixed`, or `varied` with synonyms drawn per episode."""
    force: bool = False
    """Replace the recording in DIR."""
    verbose: bool = False
    """Print the traceback of an error in an episode."""

    def advice(self) -> str:
        """Returns the state of the files after an interruption."""
        return "Nothing was written."


PUBLISH_HELP = """Prepares a folder for the Hugging Face hub; uploads nothing.

SOURCE is a folder of `hab-spa record --lerobot`, of which the first episodes are taken, a file of
weights with its card beside it, or `environment` for LeRobot's EnvHub. The folder has a card,
the licence, and checksums.

Example:
  hab-tasks publish runs/demonstrations --episodes 200 --out hub/pick
  hab-tasks publish baselines/ppo/hab_ppo/weights/pick_blind.safetensors --out hub/pick_blind
  hab-tasks publish environment --out hub/env"""


@dataclass(frozen=True, kw_only=True)
class PublishCommand(Command):
    """Options of `hab-tasks publish`."""

    help: ClassVar[str] = PUBLISH_HELP
    work: ClassVar[str] = "hab_spa.recording.publish:run"

    source: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="SOURCE")]
    """A recording, a .safetensors file, or `environment`."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Output folder."""
    episodes: Annotated[int, tyro.conf.arg(metavar="N")] = 200
    """Maximum number of episodes of a recording."""
    license: Annotated[str | None, tyro.conf.arg(metavar="ID")] = None
    """Licence of a recording in a dataset of others; apache-2.0 in the apartment."""
    force: bool = False
    """Replace DIR."""


COMMANDS: dict[str, type[Command]] = {"record": RecordCommand}

TASK_COMMANDS: dict[str, type[Command]] = {"publish": PublishCommand}
"""Subcommands that `hab-tasks` finds by the entry point of this package."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs `hab-spa`; returns its exit status."""
    return run_script("hab-spa", COMMANDS, arguments)
