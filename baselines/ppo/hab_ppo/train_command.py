"""The command `hab-ppo train`."""

from __future__ import annotations

import os
import shlex
import shutil
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from hab_ppo.plan import DISTILLED_SO_FAR, EXACT, RECIPE
from hab_ppo.recipe import (
    MOST_EPISODES,
    MOST_RANKS,
    MOST_ROWS,
    MOST_STEPS,
    PRESETS,
    Recipe,
    changed,
)
from hab_ppo.recipes import find_recipe
from hab_tasks.errors import OptionError, UnknownNameError
from hab_tasks.io.console import Command
from hab_tasks.io.files import check_folder
from hab_tasks.io.pool import start_server
from hab_tasks.option_values import LARGEST_SEED, whole

TRAIN_HELP = """Trains a policy by its recipe.

Example:
  hab-ppo train pick_blind --ranks 2 --out runs/pick_blind

Writes checkpoints, the best weights (best.safetensors), progress.jsonl and TensorBoard files to
the output folder; --resume continues an interrupted run. On several machines:
  torchrun --nnodes 2 --nproc-per-node 2 ... -m hab_ppo train pick_blind --out runs/pick_blind"""


@dataclass(frozen=True, kw_only=True)
class TrainCommand(Command):
    """Options of `hab-ppo train`."""

    help: ClassVar[str] = TRAIN_HELP
    work: ClassVar[str] = "hab_ppo.trainer:run"

    recipe: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="NAME")]
    """A recipe of `hab-ppo list`, or `module:NAME` for your own."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """The run's folder."""
    ranks: Annotated[int, tyro.conf.arg(metavar="R")] = 1
    """Number of processes that learn together, each with its own environments."""
    seed: Annotated[int, tyro.conf.arg(metavar="S")] = 0
    """Seed of the run."""
    preset: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """paper, fast, recurrent or visual, instead of the recipe's learner."""
    steps: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Environment steps in all, instead of the recipe's."""
    rows: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Simulations of each rank, instead of the preset's."""
    rollout_steps: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Steps of each row in an update, instead of the preset's."""
    episodes: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Number of training episodes, instead of the recipe's."""
    evaluation_steps: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Steps between evaluations, instead of the recipe's."""
    evaluation_episodes: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Episodes of an evaluation, instead of the recipe's."""
    evaluation_split: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """Split of the evaluations, where a dataset has no val."""
    robot: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """Another robot: fetch, fetch_friction, panda_mobile, or `module:uid` for your own."""
    scene_dataset: Annotated[str | None, tyro.conf.arg(metavar="NAME|PATH")] = None
    """`apartment` (included), or a ReplicaCAD folder, instead of the recipe's."""
    objects: Annotated[str | None, tyro.conf.arg(metavar="PATH")] = None
    """A YCB folder, instead of the included objects."""
    demonstrations: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Demonstrations of `hab-ppo demonstrate` for a recipe that starts from some."""
    teacher: Annotated[Path | None, tyro.conf.arg(metavar="PATH")] = None
    """Run or weights of the teacher, for a recipe that distils a teacher or an expert."""
    weights: Annotated[Path | None, tyro.conf.arg(metavar="NAME|PATH")] = None
    """Policy that ships, run or file to start from, without demonstrations or teacher."""
    scratch: bool = False
    """Start from random weights, without the recipe's demonstrations or teacher."""
    resume: bool = False
    """Continue the run in DIR after its last update."""
    exact: bool = False
    """With --resume: continue after the last evaluation, as if never interrupted."""
    force: bool = False
    """Replace the run in DIR."""
    verbose: bool = False
    """Print the traceback of an error in an environment."""

    def run(self) -> int:
        """Trains; worker processes import the simulator while this one does."""
        if self.ranks == 1 or "WORLD_SIZE" in os.environ:
            start_server("hab_tasks.vector.workers", "hab_tasks.episodes.making")
        return super().run()

    def arguments(self) -> list[str]:
        """Returns the arguments of a rank: those given, but for --force."""
        words = ["train", self.recipe]
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name in ("recipe", "force") or value in (None, False):
                continue
            option = "--" + field.name.replace("_", "-")
            words += [option] if value is True else [option, str(value)]
        return words

    def command(self) -> str:
        """Returns the command of this run, without its folder and how it goes on."""
        fresh = replace(self, resume=False, exact=False, force=False, verbose=False)
        words = fresh.arguments()
        where = words.index("--out")
        return shlex.join(["hab-ppo", *words[:where], *words[where + 2 :]])

    def resolved_recipe(self) -> Recipe:
        """Returns the recipe with the options given."""
        self._check_numbers()
        recipe = find_recipe(self.recipe)
        if self.scratch:
            recipe = replace(recipe, warm_start=None, distill=None)
        if self.preset is not None and self.preset not in PRESETS:
            raise UnknownNameError("preset", self.preset, PRESETS)
        preset = recipe.preset if self.preset is None else PRESETS[self.preset]
        preset = changed(preset, rows=self.rows, rollout_steps=self.rollout_steps)
        if preset.rows < preset.ppo.minibatches:
            minibatches = f"{preset.ppo.minibatches}, the number of minibatches of whole rows"
            raise OptionError.of_value("--rows", preset.rows, f"at least {minibatches}")
        return changed(
            recipe,
            preset=preset,
            env=changed(
                recipe.env,
                robot=self.robot,
                num_episodes=self.episodes,
                scene_dataset=self.scene_dataset,
                objects=self.objects,
            ),
            total_steps=self.steps,
            evaluation_steps=self.evaluation_steps,
            evaluation_episodes=self.evaluation_episodes,
            evaluation_split=self.evaluation_split,
        )

    def _check_numbers(self) -> None:
        """Rejects numbers out of range."""
        whole("--ranks", self.ranks, 1, MOST_RANKS)
        whole("--seed", self.seed, 0, LARGEST_SEED)
        for name, most in (
            ("steps", MOST_STEPS),
            ("rows", MOST_ROWS),
            ("rollout_steps", MOST_STEPS),
            ("episodes", MOST_EPISODES),
            ("evaluation_steps", MOST_STEPS),
            ("evaluation_episodes", MOST_EPISODES),
        ):
            value = getattr(self, name)
            if value is not None:
                whole(f"--{name.replace('_', '-')}", value, 1, most)
        others = ("scratch", "demonstrations", "teacher")
        if self.weights is not None and any(getattr(self, name) for name in others):
            words = ", ".join(f"--{name}" for name in others)
            raise OptionError(f"--weights says from what a run starts; leave out {words}.")
        if self.exact and not self.resume:
            raise OptionError("--exact says from where --resume continues; give both.")

    def check_out(self) -> None:
        """Checks the output folder; with --force, empties it."""
        if self.resume:
            if not any((self.out / name).is_file() for name in (RECIPE, DISTILLED_SO_FAR)):
                raise OptionError(f"--resume: there is no run in {self.out}.")
            if self.exact and not (self.out / EXACT).is_file():
                raise OptionError(f"--exact: the run in {self.out} had no evaluation yet.")
            return
        check_folder(self.out, force=self.force, mark=RECIPE)
        if self.force:
            shutil.rmtree(self.out, ignore_errors=True)

    def advice(self) -> str:
        """Returns how to continue."""
        return f"The last update is kept: --resume continues {self.out}."
