"""The console script `hab-ppo`."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import tyro

from hab_ppo.launch import is_prepared, is_rank, launch
from hab_tasks.console import EXIT_INTERRUPTED, Command, run_script
from hab_tasks.errors import OptionError
from hab_tasks.files import check_file, check_folder
from hab_tasks.option_values import LARGEST_SEED, whole

if TYPE_CHECKING:
    from hab_ppo.recipe import Recipe
    from hab_ppo.trainer import TrainPlan

DESCRIPTION = "Recurrent PPO and DD-PPO for the skills of the Home Assistant Benchmark."
MOST_RANKS = 256
MOST_ROWS = 4096
MOST_EPISODES = 1_000_000
MOST_STEPS = 10**12

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
    scene_dataset: Annotated[str | None, tyro.conf.arg(metavar="NAME|PATH")] = None
    """`apartment` (included), or a ReplicaCAD folder, instead of the recipe's."""
    objects: Annotated[str | None, tyro.conf.arg(metavar="PATH")] = None
    """A YCB folder, instead of the included objects."""
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
            try:
                return self._train(recipe)
            except KeyboardInterrupt:  # the launcher reports it, once
                return EXIT_INTERRUPTED
        self._check_out()
        if self.ranks == 1:
            return self._train(recipe)
        self._check_launch(recipe)
        launch(self.ranks, self._arguments())
        return 0

    def _check_launch(self, recipe: Recipe) -> None:
        """Rejects bad input here, once, and not in each rank."""
        from hab_ppo.checkpoint import load
        from hab_ppo.trainer import check_same, prepare_episodes

        plan = self._plan(recipe)
        if plan.resume is not None:
            check_same(plan, load(plan.out / plan.resume)[1])
        prepare_episodes(recipe, self.ranks, _say)  # also checks the environment's options

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

    def _plan(self, recipe: Recipe) -> TrainPlan:
        from hab_ppo.trainer import EXACT, LAST, TrainPlan

        resumes = self.resume or (is_prepared() and (self.out / LAST).exists())
        resume = (EXACT if self.exact else LAST) if resumes else None
        return TrainPlan(recipe=recipe, out=self.out, seed=self.seed, resume=resume)

    def _train(self, recipe: Recipe) -> int:
        # Imported here: loading the simulator takes seconds, and --help does not need it.
        from hab_ppo.distributed import Ranks
        from hab_ppo.trainer import Trainer

        ranks = Ranks()
        if is_rank() and not is_prepared() and ranks.is_first:
            self._check_out()
        try:
            end = Trainer(self._plan(recipe), ranks, _say).run()
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
        from hab_ppo.recipe import PRESETS, changed
        from hab_ppo.recipes import find_recipe
        from hab_tasks.errors import UnknownNameError

        self._check_numbers()
        recipe = find_recipe(self.recipe)
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
        if self.exact and not self.resume:
            raise OptionError("--exact says from where --resume continues; give both.")

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


EVAL_HELP = """Plays episodes with the best weights of a run, greedily.

Example:
  hab-ppo eval runs/pick_blind --episodes 100

For a run.json with videos, failures and stages, use the weights as an agent:
  hab-eval run --agent hab_ppo:policy --option weights=runs/pick_blind --env HabPick-v1 --out DIR"""


@dataclass(frozen=True, kw_only=True)
class EvalCommand(Command):
    """Options of `hab-ppo eval`."""

    help: ClassVar[str] = EVAL_HELP

    weights: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="PATH")]
    """A run's folder, or a file of weights."""
    episodes: Annotated[int, tyro.conf.arg(metavar="N")] = 100
    """Number of episodes."""
    split: Annotated[str, tyro.conf.arg(metavar="NAME")] = "val"
    """Split of the episodes."""
    seed: Annotated[int, tyro.conf.arg(metavar="S")] = 0
    """Seed of the episodes."""
    rows: Annotated[int, tyro.conf.arg(metavar="N")] = 16
    """Simulations side by side."""
    workers: Annotated[int, tyro.conf.arg(metavar="W")] = 2
    """Number of processes."""
    verbose: bool = False
    """Print the traceback of an error in an environment."""

    def run(self) -> int:
        """Plays the episodes and prints the success rate."""
        whole("--episodes", self.episodes, 1, MOST_EPISODES)
        whole("--rows", self.rows, 1, MOST_ROWS)
        whole("--workers", self.workers, 1, MOST_RANKS)
        whole("--seed", self.seed, 0, LARGEST_SEED)
        from hab_eval.stats import wilson_interval

        from hab_ppo.agent import weights_file
        from hab_ppo.play import play

        result = play(
            weights_file(self.weights),
            split=self.split,
            episodes=self.episodes,
            seed=self.seed,
            rows=self.rows,
            workers=self.workers,
        )
        low, high = wilson_interval(result.successes, result.episodes)
        print(
            f"success {result.successes / result.episodes:.1%} ({result.successes} of "
            f"{result.episodes}, 95 % interval {low:.1%} to {high:.1%})"
        )
        print(f"return {result.mean_return:.2f}, {result.mean_steps:.0f} steps (means)")
        return 0


PLOT_HELP = """Draws the learning curves of one or more runs.

Example:
  hab-ppo plot runs/pick_blind runs/pick_blind_paper --out curves.png"""


@dataclass(frozen=True, kw_only=True)
class PlotCommand(Command):
    """Options of `hab-ppo plot`."""

    help: ClassVar[str] = PLOT_HELP

    runs: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="DIR")]
    """Folders of runs."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Output file; curves.png in the first run's folder if not given."""
    force: bool = False
    """Replace FILE."""

    def run(self) -> int:
        """Draws the picture."""
        from hab_ppo.curves import draw_curves

        if not self.runs:
            raise OptionError("Give at least one folder of a run.")
        out = self.runs[0] / "curves.png" if self.out is None else self.out
        # The default file is the run's own, and is drawn again as the run goes on.
        check_file(out, force=self.force or self.out is None)
        draw_curves(self.runs, out)
        print(f"wrote {out}")
        return 0


@dataclass(frozen=True, kw_only=True)
class ListCommand(Command):
    """Options of `hab-ppo list`."""

    help: ClassVar[str] = "Lists the recipes.\n\nExample:\n  hab-ppo list"

    def run(self) -> int:
        """Prints a line for each recipe."""
        from hab_ppo.recipes import find_recipe, recipe_names

        for name in recipe_names():
            recipe = find_recipe(name)
            config = recipe.env
            print(
                f"{name:24s} {config.env:22s} {config.control_mode:14s} {config.obs_mode:11s} "
                f"{recipe.total_steps:>11,} steps  {recipe.about}"
            )
        return 0


COMMANDS: dict[str, type[Command]] = {
    "train": TrainCommand,
    "eval": EvalCommand,
    "plot": PlotCommand,
    "list": ListCommand,
}


def _say(text: str) -> None:
    print(text, flush=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs `hab-ppo`; returns its exit status."""
    return run_script("hab-ppo", COMMANDS, arguments, DESCRIPTION)
