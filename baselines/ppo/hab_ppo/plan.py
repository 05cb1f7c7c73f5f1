"""A run to be made or continued, and the files in its folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hab_ppo.recipe import Recipe, RecipeError
from hab_tasks.typed_values import to_json

RECIPE = "recipe.json"
"""The resolved recipe, in the run's folder."""

LAST, EXACT, BEST = (f"{name}.safetensors" for name in ("last", "exact", "best"))
"""Checkpoints of the last update and of the last evaluation, and the best weights."""

CLONED, DEMONSTRATIONS = "cloned.safetensors", "demonstrations.safetensors"
"""The weights from which PPO starts after a warm start, and what they were cloned from."""

DISTILLED_SO_FAR = "distilled_so_far.safetensors"
"""The weights after the last round of a distillation that has not ended."""


@dataclass(frozen=True, kw_only=True)
class TrainPlan:
    """A run to be made or continued.

    Attributes:
        recipe: What is trained.
        out: The run's folder.
        seed: Seed of weights, actions, minibatches and episodes.
        resume: Checkpoint to continue from, `LAST` or `EXACT`; None to start anew.
        demonstrations: File of demonstrations for the recipe's warm start; None to make them.
        teacher: Weights or run of the teacher, instead of those that the recipe names.
        weights: Name, run or file of weights to start from, instead of random ones.
        command: The command of the run, for its description.
    """

    recipe: Recipe
    out: Path
    seed: int = 0
    resume: str | None = None
    demonstrations: Path | None = None
    teacher: Path | None = None
    weights: Path | None = None
    command: str = ""


def check_same(plan: TrainPlan, about: Mapping[str, Any]) -> None:
    """Rejects a checkpoint of another recipe or seed; only the length of the run may change.

    Raises:
        RecipeError: The description `about` is of another run.
    """
    recipe, found = to_json(plan.recipe), about["recipe"]
    different = [
        name
        for name in sorted(recipe.keys() | found.keys())
        if name not in ("total_steps", "about") and recipe.get(name) != found.get(name)
    ]
    if different:
        raise RecipeError(
            f"The run in {plan.out} has another {different[0]}; give the options of that run."
        )
    if about["seed"] != plan.seed:
        raise RecipeError(f"The run in {plan.out} has seed {about['seed']}, not {plan.seed}.")
