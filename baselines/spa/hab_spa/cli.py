"""The console script `hab-spa`: options of its command."""

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
    """Number of workers with --executor ray; does not change the recording."""
    lerobot: bool = False
    """Also write a LeRobot dataset (v3.0) to DIR/lerobot; requires pyarrow."""
    force: bool = False
    """Replace the recording in DIR."""
    verbose: bool = False
    """Print the traceback of an error in an episode."""

    def advice(self) -> str:
        """Returns the state of the files after an interruption."""
        return "Nothing was written."


COMMANDS: dict[str, type[Command]] = {"record": RecordCommand}


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs `hab-spa`; returns its exit status."""
    return run_script("hab-spa", COMMANDS, arguments)
