"""The command `hab-ppo navigator`."""

from __future__ import annotations

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro
from hab_ppo.limits import MOST_EPISODES, MOST_RANKS, MOST_ROWS
from hab_ppo.progress import say

from hab_tasks.console import Command
from hab_tasks.files import check_folder
from hab_tasks.option_values import LARGEST_SEED, whole


@dataclass(frozen=True, kw_only=True)
class NavigatorCommand(Command):
    """Options of `hab-ppo navigator`."""

    help: ClassVar[str] = """Trains the navigator of Navigate: a map, a goal network, shortest ways.

Example:
  hab-ppo navigator --workers 2 --out runs/navigator

The same command continues an interrupted run after its last round. To play with the weights:
  hab-eval run --agent hab_ppo:navigator --option weights=runs/navigator \\
    --env HabNavigate-v1 --out DIR"""

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """The run's folder."""
    rounds: Annotated[int, tyro.conf.arg(metavar="N")] = 4
    """Rounds of practice, each followed by a fit."""
    episodes: Annotated[int, tyro.conf.arg(metavar="N")] = 1000
    """Episodes of a round."""
    epochs: Annotated[int, tyro.conf.arg(metavar="N")] = 10
    """Epochs of a fit."""
    training_episodes: Annotated[int, tyro.conf.arg(metavar="N")] = 3000
    """Number of different episodes, of which practice draws."""
    rows: Annotated[int, tyro.conf.arg(metavar="N")] = 10
    """Simulations of each process."""
    workers: Annotated[int, tyro.conf.arg(metavar="W")] = 2
    """Number of processes."""
    seed: Annotated[int, tyro.conf.arg(metavar="S")] = 0
    """Seed of the run."""
    scene_dataset: Annotated[str, tyro.conf.arg(metavar="NAME|PATH")] = "apartment"
    """`apartment` (included), or a ReplicaCAD folder."""
    objects: Annotated[str | None, tyro.conf.arg(metavar="PATH")] = None
    """A YCB folder, instead of the included objects."""
    force: bool = False
    """Replace the run in DIR."""
    verbose: bool = False
    """Print the traceback of an error in an environment."""

    def run(self) -> int:
        """Trains."""
        for name in ("rounds", "episodes", "epochs", "training_episodes"):
            whole(f"--{name.replace('_', '-')}", getattr(self, name), 1, MOST_EPISODES)
        whole("--rows", self.rows, 1, MOST_ROWS)
        whole("--workers", self.workers, 1, MOST_RANKS)
        whole("--seed", self.seed, 0, LARGEST_SEED)
        # Loads the simulator, which --help does not need.
        from hab_navigator.training import LESSONS, PLAYED, WEIGHTS, TrainingPlan, train

        files = (WEIGHTS, PLAYED)
        if self.force or not any((self.out / name).is_file() for name in files):
            check_folder(self.out, force=self.force, mark=WEIGHTS)
            for name in (WEIGHTS, LESSONS, PLAYED):
                (self.out / name).unlink(missing_ok=True)
        plan = TrainingPlan(
            scene_dataset=self.scene_dataset,
            objects=self.objects,
            num_episodes=self.training_episodes,
            rounds=self.rounds,
            episodes=self.episodes,
            epochs=self.epochs,
            rows=self.rows,
            workers=self.workers,
            seed=self.seed,
            out=self.out,
            command=shlex.join(["hab-ppo", *sys.argv[1:]]),
        )
        train(plan, say)
        say(f"wrote {self.out / WEIGHTS}")
        return 0
