"""The console script `hab-ppo`."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import tyro

from hab_ppo.launch import is_prepared, is_rank, launch
from hab_tasks.console import Command, run_script
from hab_tasks.errors import OptionError
from hab_tasks.files import check_folder
from hab_tasks.option_values import LARGEST_SEED, whole

if TYPE_CHECKING:
    from hab_ppo.recipe import Recipe

DESCRIPTION = "Recurrent PPO and DD-PPO for the skills of the Home Assistant Benchmark."
MOST_RANKS = 256

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

    recipe: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="NAME")]
    """A recipe of `hab-ppo list`, or `module:NAME` for your own."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """The run's folder."""
    ranks: Annotated[int, tyro.conf.arg(metavar="R")] = 1
    """Number of processes that learn together, each with its own environments."""
    seed: Annotated[int, tyro.conf.arg(metavar="S")] = 0
    """Seed of the run."""
    preset: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """paper or fast, instead of the recipe's learner."""
    steps: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Environment steps in all, instead of the recipe's."""
    rows: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Simulations of each rank, instead of the preset's."""
    episodes: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Number of training episodes, instead of the recipe's."""
    evaluation_steps: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Steps between evaluations, instead of the recipe's."""
    evaluation_episodes: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Episodes of an evaluation, instead of the recipe's."""
    resume: bool = False
    """Continue the run in DIR after its last update."""
    exact: bool = False
    """With --resume: continue after the last evaluation, as if never interrupted."""
    force: bool = False
    """Replace the run in DIR."""
    verbose: bool = False
    """Print the traceback of an error in an environment."""

    def run(self) -> int:
        """Trains in this process, or starts the ranks that do."""
        recipe = self._recipe()
        if is_rank():
            return self._train(recipe)
        self._check_out()
        if self.ranks == 1:
            return self._train(recipe)
        from hab_ppo.trainer import prepare_episodes

        prepare_episodes(recipe, self.ranks, _say)  # also checks the environment's options
        launch(self.ranks, self._arguments())
        return 0

    def _arguments(self) -> list[str]:
        """Returns the arguments of a rank: those given, but for --force."""
        words = ["train", self.recipe]
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name in ("recipe", "force") or value in (None, False):
                continue
            option = "--" + field.name.replace("_", "-")
            words += [option] if value is True else [option, str(value)]
        return words

    def _train(self, recipe: Recipe) -> int:
        # Imported here: loading the simulator takes seconds, and --help does not need it.
        from hab_ppo.distributed import Ranks
        from hab_ppo.trainer import EXACT, LAST, Trainer, TrainPlan

        resumes = self.resume or (is_prepared() and (self.out / LAST).exists())
        checkpoint = EXACT if self.exact else LAST
        plan = TrainPlan(
            recipe=recipe,
            out=self.out,
            seed=self.seed,
            resume=checkpoint if resumes else None,
        )
        ranks = Ranks()
        if is_rank() and not is_prepared() and ranks.is_first:
            self._check_out()
        try:
            end = Trainer(plan, ranks, _say).run()
        finally:
            ranks.close()
        if ranks.is_first and end.best_success is not None:
            _say(
                f"{end.steps:,} steps in {end.seconds / 60:.1f} min; best {end.best_success:.0%} "
                f"at {end.best_steps:,} steps, in {self.out / 'best.safetensors'}"
            )
        return 0

    def _recipe(self) -> Recipe:
        """Returns the recipe with the options given."""
        from hab_ppo.recipe import PRESETS
        from hab_ppo.recipes import find_recipe
        from hab_tasks.errors import UnknownNameError

        whole("--ranks", self.ranks, 1, MOST_RANKS)
        whole("--seed", self.seed, 0, LARGEST_SEED)
        if self.exact and not self.resume:
            raise OptionError("--exact says from where --resume continues; give both.")
        recipe = find_recipe(self.recipe)
        if self.preset is not None:
            if self.preset not in PRESETS:
                raise UnknownNameError("preset", self.preset, PRESETS)
            recipe = replace(recipe, preset=PRESETS[self.preset])
        if self.rows is not None:
            recipe = replace(recipe, preset=replace(recipe.preset, rows=self.rows))
        if self.episodes is not None:
            recipe = replace(recipe, env=replace(recipe.env, num_episodes=self.episodes))
        given = {
            "total_steps": self.steps,
            "evaluation_steps": self.evaluation_steps,
            "evaluation_episodes": self.evaluation_episodes,
        }
        return replace(recipe, **{k: v for k, v in given.items() if v is not None})

    def _check_out(self) -> None:
        """Checks the output folder; with --force, empties it."""
        if self.resume:
            if not (self.out / "recipe.json").is_file():
                raise OptionError(f"--resume: there is no run in {self.out}.")
            return
        check_folder(self.out, force=self.force, mark="recipe.json")
        if self.force:
            shutil.rmtree(self.out, ignore_errors=True)

    def advice(self) -> str:
        """Returns how to continue."""
        return f"The last update is kept: --resume continues {self.out}."


COMMANDS: dict[str, type[Command]] = {"train": TrainCommand}


def _say(text: str) -> None:
    print(text, flush=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs `hab-ppo`; returns its exit status."""
    return run_script("hab-ppo", COMMANDS, arguments, DESCRIPTION)
