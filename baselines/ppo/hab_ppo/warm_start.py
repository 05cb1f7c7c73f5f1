"""What a run does before PPO: demonstrations and cloning, or distillation.

The first rank makes what is missing in the run's folder, and the others take its weights. A run
that continues finds the files and makes nothing anew.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import gymnasium as gym

from hab_ppo import checkpoint
from hab_ppo.cloning import clone
from hab_ppo.demonstrations import DemonstrationPlan, demonstrate
from hab_ppo.distillation import distill, load_teacher, teacher_file
from hab_ppo.distributed import Ranks
from hab_ppo.errors import RecipeError
from hab_ppo.examples import Examples, read_examples, write_examples
from hab_ppo.fine_tuning import Guide
from hab_ppo.network import Policy
from hab_ppo.plan import CLONED, DEMONSTRATIONS, TrainPlan, check_same
from hab_ppo.progress import WriteLine
from hab_ppo.recipe import Recipe, to_json


def check_start(plan: TrainPlan) -> None:
    """Rejects files that a run cannot start from, before the run begins.

    Raises:
        RecipeError: The recipe has no use for them, or they do not fit it.
        PolicyFileError: They cannot be used.
    """
    recipe = plan.recipe
    if plan.demonstrations is not None and recipe.warm_start is None:
        raise RecipeError(f"--demonstrations: {recipe.name} does not start from demonstrations.")
    if plan.teacher is not None and recipe.distill is None:
        raise RecipeError(f"--teacher: {recipe.name} has no teacher.")
    if plan.resume is not None:
        return
    if plan.demonstrations is not None:
        read_examples(plan.demonstrations, recipe.env)
    if recipe.distill is not None:
        load_teacher(_teacher(plan), recipe.env, None)


def start_policy(
    plan: TrainPlan, ranks: Ranks, policy: Policy, write_line: WriteLine
) -> Guide | None:
    """Sets a policy to the weights from which PPO starts; returns them as a guide.

    Returns:
        None if the recipe starts from random weights.
    """
    tuning, path = plan.recipe.tuning, plan.out / CLONED
    if tuning is None:
        return None
    if ranks.is_first and not path.exists():
        _make(plan, ranks, policy, write_line)
    data = ranks.from_first(checkpoint.read(path) if ranks.is_first else b"")
    tensors, about = checkpoint.parse(data, path)
    check_same(plan, about)
    checkpoint.load_network(policy, tensors, path)
    return Guide(policy, tuning)


def make_rows(recipe: Recipe, rows: int, workers: int) -> Any:
    """Returns a vector environment of a recipe."""
    return gym.make_vec(
        recipe.env.reference,
        num_envs=rows,
        num_workers=workers,
        info_keys=("success",),
        copy=False,
        **recipe.env.options(),
    )


def _make(plan: TrainPlan, ranks: Ranks, policy: Policy, write_line: WriteLine) -> None:
    """Writes the weights from which PPO starts."""
    began, recipe = time.perf_counter(), plan.recipe
    if recipe.warm_start is not None:
        config = recipe.warm_start
        examples, made = _demonstrations(plan, ranks, write_line)
        fit = clone(policy, examples, config.cloning, plan.seed, write_line)
        policy.head.explore(config.tuning.log_std)
    else:
        assert recipe.distill is not None
        made = {"teacher": str(_teacher(plan))}
        teacher = load_teacher(_teacher(plan), recipe.env, policy.layout)
        env = make_rows(recipe, recipe.preset.rows * ranks.size, ranks.on_machine)
        try:
            fit = distill(policy, teacher, env, recipe.distill, plan.seed, write_line)
        finally:
            env.close()
    seconds = time.perf_counter() - began
    write_line(f"cloned in {seconds / 60:.1f} min, held-out loss {fit.held_out_loss:.4f}")
    about = {
        "recipe": to_json(recipe),
        "seed": plan.seed,
        "seconds": seconds,
        "fit": {"epochs": fit.epochs, "loss": fit.loss, "held_out_loss": fit.held_out_loss},
        "made_from": made,
    }
    checkpoint.save(plan.out / CLONED, checkpoint.network_tensors(policy), about)


def _demonstrations(
    plan: TrainPlan, ranks: Ranks, write_line: WriteLine
) -> tuple[Examples, dict[str, Any]]:
    """Returns the demonstrations of a run, made if there are none, and their description."""
    recipe, config = plan.recipe, plan.recipe.warm_start
    assert config is not None
    path = plan.demonstrations or plan.out / DEMONSTRATIONS
    if not path.exists() and plan.demonstrations is None:
        wanted = DemonstrationPlan(
            recipe=recipe,
            agent=config.agent,
            count=config.demonstrations,
            noise=config.noise,
            seed=plan.seed,
            workers=ranks.on_machine,
        )
        write_demonstrations(path, wanted, write_line)
    examples, about = read_examples(path, recipe.env)
    return examples, {name: about[name] for name in ("agent", "seed", "counts")}


def write_demonstrations(path: Path, plan: DemonstrationPlan, write_line: WriteLine) -> None:
    """Makes demonstrations and writes them to a file."""
    made = demonstrate(plan, write_line)
    write_line(f"{len(made.parts)} demonstrations: {made.summary()}")
    about = {
        "agent": plan.agent,
        "noise": plan.noise,
        "seed": plan.seed,
        "counts": made.counts(),
    }
    write_examples(path, Examples.joined(made.parts), plan.recipe.env, about)


def _teacher(plan: TrainPlan) -> Path:
    """Returns the file of the teacher's weights."""
    assert plan.recipe.distill is not None
    return teacher_file(str(plan.teacher or plan.recipe.distill.teacher))
