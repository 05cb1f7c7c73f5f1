"""Start of a training run in one process, or in the ranks that `hab-ppo train` launches."""

from __future__ import annotations

from collections.abc import Callable

from hab_ppo.checkpoint import load
from hab_ppo.distributed import Ranks
from hab_ppo.episodes import prepare_episodes
from hab_ppo.launch import is_prepared, is_rank
from hab_ppo.plan import TrainPlan, check_same
from hab_ppo.progress import say
from hab_ppo.trainer import Trainer
from hab_ppo.warm_start import check_start


def check(plan: TrainPlan, ranks: int) -> None:
    """Rejects bad input once, before the ranks start.

    Raises:
        HabError: The run cannot start, or not continue, from the files given.
    """
    check_start(plan)
    if plan.resume is not None:
        check_same(plan, load(plan.out / plan.resume)[1])
    prepare_episodes(plan.recipe, ranks, say)  # also checks the environment's options


def train(make_plan: Callable[[], TrainPlan], check_out: Callable[[], None]) -> None:
    """Trains as this process's rank.

    Args:
        make_plan: Returns the plan; what it resumes from depends on the files in its folder.
        check_out: Checks or empties the folder; called by the first of ranks launched elsewhere.
    """
    if not is_rank():
        check_start(make_plan())
    ranks = Ranks()
    if is_rank() and not is_prepared() and ranks.is_first:
        check_out()
    plan = make_plan()
    try:
        end = Trainer(plan, ranks, say).run()
    finally:
        ranks.close()
    if ranks.is_first and end.best_success is not None:
        say(
            f"{end.steps:,} steps in {end.seconds / 60:.1f} min; best {end.best_success:.0%} "
            f"at {end.best_steps:,} steps, in {plan.out / 'best.safetensors'}"
        )
