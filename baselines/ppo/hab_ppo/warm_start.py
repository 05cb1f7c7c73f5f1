"""What a run does before PPO: demonstrations and cloning, distillation, or reading given weights.

The first rank makes what is missing in the run's folder, and the others take its weights. A run
that continues finds the files and makes nothing anew.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hab_ppo import checkpoint
from hab_ppo.cloning import Fit, clone
from hab_ppo.commands import DemonstrateCommand
from hab_ppo.demonstration_file import DemonstrationFile, check_sizes, read_examples, write_examples
from hab_ppo.demonstrations import DemonstrationPlan, demonstrate
from hab_ppo.distillation import (
    Expert,
    PolicyTeacher,
    check_expert,
    classroom,
    distill,
    known_weights,
    load_teacher,
)
from hab_ppo.distributed import Ranks
from hab_ppo.episodes import EpisodeSupply, training_source
from hab_ppo.examples import Examples
from hab_ppo.network import Policy
from hab_ppo.plan import CLONED, DEMONSTRATIONS, DISTILLED_SO_FAR, TrainPlan, check_same
from hab_ppo.ppo import Guide
from hab_ppo.progress import WriteLine
from hab_ppo.recipe import MOST_EPISODES, MOST_RANKS, Distillation, Recipe, RecipeError, changed
from hab_ppo.recipes import find_recipe
from hab_ppo.replay import Lesson, practise
from hab_ppo.rows import info_keys, policy_rows
from hab_tasks.errors import OptionError
from hab_tasks.io.console import tell
from hab_tasks.io.files import check_file
from hab_tasks.option_values import LARGEST_SEED, whole
from hab_tasks.typed_values import to_json


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
    if plan.weights is not None:
        checkpoint.load(known_weights(str(plan.weights), "--weights"))
        return
    if plan.demonstrations is not None:
        check_sizes(plan.demonstrations, read_examples(plan.demonstrations, recipe.env)[0], recipe)
    if recipe.distill is None:
        return
    if (expert := _expert(plan, recipe.distill)) is not None:
        check_expert(expert, recipe.env)
    else:
        classroom(recipe.env, load_teacher(_teacher(plan), recipe.env))


def start_policy(
    plan: TrainPlan, ranks: Ranks, policy: Policy, supply: EpisodeSupply, write_line: WriteLine
) -> Guide | None:
    """Sets a policy to the weights from which PPO starts; returns them as a guide.

    Returns:
        None if the recipe starts from random or given weights.
    """
    tuning, path = plan.recipe.tuning, plan.out / CLONED
    given = plan.weights if plan.resume is None else None
    if given is not None:
        _load(policy, known_weights(str(given), "--weights"), ranks)
    if tuning is None:
        return None
    is_made = ranks.from_first(str(path.exists()).encode()) == b"True"
    if not is_made and given is None:
        _make(plan, ranks, policy, supply, write_line)
    elif not is_made and given is not None and ranks.is_first:
        _save_start(plan, policy, {"made_from": {"weights": given.name}, "seconds": 0.0})
    check_same(plan, _load(policy, path, ranks))
    return Guide(policy, tuning)


def make_rows(recipe: Recipe, rows: int, workers: int) -> Any:
    """Returns a vector environment of a recipe."""
    options = {"info_keys": info_keys(recipe.env), "num_envs": rows, "num_workers": workers}
    config = replace(recipe.env, env=recipe.env.training_reference)
    return policy_rows(config, **(config.options() | options))


def _load(policy: Policy, path: Path, ranks: Ranks) -> dict[str, Any]:
    """Sets a policy to the weights of a file, read by the first rank; returns its description."""
    data = ranks.from_first(checkpoint.read(path) if ranks.is_first else b"")
    tensors, about = checkpoint.parse(data, path)
    checkpoint.load_network(policy, tensors, path)
    return about


def _make(
    plan: TrainPlan, ranks: Ranks, policy: Policy, supply: EpisodeSupply, write_line: WriteLine
) -> None:
    """Trains the weights from which PPO starts; the first rank writes them."""
    began, recipe = time.perf_counter(), plan.recipe
    if recipe.distill is not None:
        made, fit = _distilled(plan, ranks, policy, supply, write_line)
    elif not ranks.is_first:
        return
    else:
        file = _demonstrations(plan, ranks, write_line)
        made = {name: file.about[name] for name in ("agent", "seed", "counts")}
        fit = _taught(plan, ranks, policy, file, write_line)
    if not ranks.is_first:
        return
    seconds = time.perf_counter() - began
    write_line(f"cloned in {seconds / 60:.1f} min, held-out loss {fit.held_out_loss:.4f}")
    about = {
        "seconds": seconds,
        "fit": {"epochs": fit.epochs, "loss": fit.loss, "held_out_loss": fit.held_out_loss},
        "made_from": made,
    }
    _save_start(plan, policy, about)


def _save_start(plan: TrainPlan, policy: Policy, about: dict[str, Any]) -> None:
    """Writes the weights from which PPO starts."""
    about = {"recipe": to_json(plan.recipe), "seed": plan.seed, **about}
    checkpoint.save(plan.out / CLONED, checkpoint.network_tensors(policy), about)


def _taught(
    plan: TrainPlan, ranks: Ranks, policy: Policy, file: DemonstrationFile, write_line: WriteLine
) -> Fit:
    """Fits a policy to demonstrations, then to what it visits in rounds of practice."""
    recipe, config = plan.recipe, plan.recipe.warm_start
    assert config is not None
    policy.head.explore(config.tuning.log_std)
    parts = [file.examples]
    fit = clone(policy, file.examples, config.cloning, plan.seed, write_line)
    if not config.rounds:
        return fit
    source = training_source(recipe)
    lessons = [Lesson(source.get(one.number), one.path) for one in file.followed]
    env = make_rows(recipe, recipe.preset.rows * ranks.size, ranks.on_machine)
    try:
        for number in range(config.rounds):
            seed = [plan.seed, number]
            drawn = np.random.default_rng(seed).permutation(len(lessons))[: config.lessons]
            visits = practise(policy, [lessons[one] for one in drawn], env, seed)
            parts += visits.parts
            data = Examples.joined(parts)
            fit = clone(policy, data, config.refitting, plan.seed + number, write_line)
            write_line(
                f"practice, round {number + 1} of {config.rounds}: solved {visits.successes} of "
                f"{visits.episodes} episodes, {len(data.state):,} labelled steps, held out "
                f"{fit.held_out_loss:.4f}"
            )
    finally:
        env.close()
    return fit


def _distilled(
    plan: TrainPlan, ranks: Ranks, policy: Policy, supply: EpisodeSupply, write_line: WriteLine
) -> tuple[dict[str, Any], Fit]:
    """Fits a policy to its teacher; returns what the teacher was, and the fit."""
    recipe, config, rows = plan.recipe, plan.recipe.distill, plan.recipe.preset.rows
    assert config is not None
    if (expert := _expert(plan, config)) is not None:
        env = make_rows(recipe, rows, 1)
        teacher = Expert(env, expert, recipe.env.action_repeat)
        made = {"expert": expert}
    else:
        loaded = load_teacher(_teacher(plan), recipe.env)
        env = make_rows(replace(recipe, env=classroom(recipe.env, loaded)), rows, 1)
        made = {"teacher": loaded.recipe.name}  # a path would mean nothing elsewhere
        teacher = PolicyTeacher(loaded.policy, rows)
    done = _rounds_done(plan, policy) if ranks.is_first else 0
    done = int(ranks.from_first(str(done).encode()))
    if done:
        write_line(f"distillation continues after round {done} of {config.rounds}")

    def begin(number: int) -> None:
        supply.grow(env, number * config.round_steps)

    def keep(done: int) -> None:
        about = {"recipe": to_json(recipe), "seed": plan.seed, "rounds": done}
        tensors = checkpoint.network_tensors(policy)
        checkpoint.save(plan.out / DISTILLED_SO_FAR, tensors, about)

    try:
        learning = policy, teacher, env, config, plan.seed, ranks, write_line
        return made, distill(*learning, done=done, begin=begin, keep=keep)
    finally:
        env.close()


def _rounds_done(plan: TrainPlan, policy: Policy) -> int:
    """Sets a policy to what an interrupted distillation has kept; returns its number of rounds."""
    path = plan.out / DISTILLED_SO_FAR
    if not path.exists():
        return 0
    tensors, about = checkpoint.load(path)
    check_same(plan, about)
    checkpoint.load_network(policy, tensors, path)
    return int(about["rounds"])


def _demonstrations(plan: TrainPlan, ranks: Ranks, write_line: WriteLine) -> DemonstrationFile:
    """Returns the demonstrations of a run, made if there are none."""
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
    return read_examples(path, recipe.env)


def run(options: DemonstrateCommand) -> int:
    """Makes the demonstrations."""
    whole("--count", options.count, 1, MOST_EPISODES)
    whole("--workers", options.workers, 1, MOST_RANKS)
    whole("--seed", options.seed, 0, LARGEST_SEED)
    if options.episodes is not None:
        whole("--episodes", options.episodes, 1, MOST_EPISODES)
    if not 0 <= options.noise <= 1:
        raise OptionError.of_value("--noise", options.noise, "from 0 to 1")
    recipe = find_recipe(options.recipe)
    recipe = changed(recipe, env=changed(recipe.env, num_episodes=options.episodes))
    check_file(options.out, force=options.force)
    plan = DemonstrationPlan(
        recipe=recipe,
        agent=options.agent,
        count=options.count,
        noise=options.noise,
        seed=options.seed,
        workers=options.workers,
    )
    write_demonstrations(options.out, plan, tell)
    return 0


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
    env = plan.recipe.env
    write_examples(path, Examples.joined(made.parts), made.followed, env, about)


def _expert(plan: TrainPlan, config: Distillation) -> str | None:
    """Returns the recipe's expert, unless a policy teaches in its place."""
    return config.expert if plan.teacher is None else None


def _teacher(plan: TrainPlan) -> Path:
    """Returns the file of the teacher's weights."""
    assert plan.recipe.distill is not None
    return known_weights(str(plan.teacher or plan.recipe.distill.teacher), "--teacher")
