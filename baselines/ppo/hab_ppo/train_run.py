"""Start of a training run in one process, or in the ranks that `hab-ppo train` launches."""

from __future__ import annotations

from hab_ppo.checkpoint import load
from hab_ppo.distributed import Ranks, is_prepared, is_rank, launch
from hab_ppo.episodes import check_episodes
from hab_ppo.plan import EXACT, LAST, TrainPlan, check_same
from hab_ppo.recipe import Recipe
from hab_ppo.train_command import TrainCommand
from hab_ppo.trainer import train_rank
from hab_ppo.warm_start import check_start
from hab_tasks.io.console import EXIT_INTERRUPTED, tell


def run(options: TrainCommand) -> int:
    """Trains in this process, or starts the ranks that do.

    Raises:
        HabError: The run cannot start, or not continue, from the files given.
    """
    recipe = options.resolved_recipe()
    if is_rank():
        try:
            return _train(options, recipe)
        except KeyboardInterrupt:  # the launcher reports it, once
            return EXIT_INTERRUPTED
    options.check_out()
    if options.ranks == 1:
        return _train(options, recipe)
    _check(_plan(options, recipe))
    launch(options.ranks, options.arguments())
    return 0


def _check(plan: TrainPlan) -> None:
    """Rejects bad input here, once, and not in each rank."""
    check_start(plan)
    if plan.resume is not None:
        check_same(plan, load(plan.out / plan.resume)[1])
    check_episodes(plan.recipe)


def _plan(options: TrainCommand, recipe: Recipe) -> TrainPlan:
    # A run that was interrupted before its first update has neither; it begins where it was.
    checkpoint = EXACT if options.exact else LAST
    resumes = (options.resume or is_prepared()) and (options.out / checkpoint).exists()
    return TrainPlan(
        recipe=recipe,
        out=options.out,
        seed=options.seed,
        resume=checkpoint if resumes else None,
        demonstrations=options.demonstrations,
        teacher=options.teacher,
        weights=options.weights,
        command=options.command(),
    )


def _train(options: TrainCommand, recipe: Recipe) -> int:
    """Trains as this process's rank."""
    if not is_rank():
        check_start(_plan(options, recipe))
    ranks = Ranks()
    if is_rank() and not is_prepared() and ranks.is_first:
        options.check_out()
    plan = _plan(options, recipe)  # what it resumes from depends on the files left in the folder
    try:
        end = train_rank(plan, ranks, tell)
    finally:
        ranks.close()
    if ranks.is_first and end.best_success is not None:
        tell(
            f"{end.steps:,} steps in {end.seconds / 60:.1f} min; best {end.best_success:.0%} "
            f"at {end.best_steps:,} steps, in {plan.out / 'best.safetensors'}"
        )
    return 0
