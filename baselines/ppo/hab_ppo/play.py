"""Evaluation of a file of weights on episodes of any split."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from hab_eval.records.stats import wilson_interval

from hab_ppo import checkpoint
from hab_ppo.actions import ActionNoise
from hab_ppo.agent import recipe_of, weights_file
from hab_ppo.commands import EvalCommand
from hab_ppo.network import new_policy
from hab_ppo.observation import ObservationLayout
from hab_ppo.recipe import MOST_EPISODES, MOST_RANKS, MOST_ROWS, Recipe
from hab_ppo.rows import binary_entries, evaluate, policy_rows
from hab_tasks.engine.rollout import Outcome
from hab_tasks.episodes import EpisodeRequest, load_episodes
from hab_tasks.io.console import tell
from hab_tasks.io.threads import use_one_thread
from hab_tasks.option_values import LARGEST_SEED, whole


def run(options: EvalCommand) -> int:
    """Plays the episodes and prints the success rate."""
    whole("--episodes", options.episodes, 1, MOST_EPISODES)
    whole("--rows", options.rows, 1, MOST_ROWS)
    whole("--workers", options.workers, 1, MOST_RANKS)
    whole("--seed", options.seed, 0, LARGEST_SEED)
    played = play(
        options.weights,
        split=options.split,
        episodes=options.episodes,
        seed=options.seed,
        rows=options.rows,
        workers=options.workers,
    )
    successes, count = sum(one.success for one in played), len(played)
    low, high = wilson_interval(successes, count)
    tell(
        f"success {successes / count:.1%} ({successes} of {count}, 95 % interval {low:.1%} to "
        f"{high:.1%})"
    )
    mean_return = np.mean([one.episode_return for one in played])
    tell(f"return {mean_return:.2f}, {np.mean([one.steps for one in played]):.0f} steps (means)")
    return 0


def play(
    path: Path, *, split: str, episodes: int, seed: int, rows: int, workers: int
) -> list[Outcome]:
    """Plays episodes with the weights of a file; returns their outcomes in order.

    Args:
        path: A run's folder, or a file of weights.
        split: Split of the episodes.
        episodes: Their number.
        seed: Their seed.
        rows: Number of simulations.
        workers: Number of processes.
    """
    use_one_thread()
    path = weights_file(path)
    tensors, about = checkpoint.load(path)
    recipe = recipe_of(about, path)
    config = recipe.env
    request = EpisodeRequest(
        env_id=config.reference,
        scene_dataset=config.scene_dataset,
        objects=config.objects,
        split=split,
        seed=seed,
        robot=config.robot_reference,
    )
    wanted = load_episodes(request, episodes, None, workers).episodes
    env = policy_rows(
        config,
        num_envs=min(rows, episodes),
        num_workers=min(workers, rows, episodes),
        autoreset_mode="Disabled",
        **(config.options() | {"split": split, "episode_seed": seed}),
    )
    try:
        network, space = recipe.preset.network, env.single_action_space
        layout = ObservationLayout.of(env.single_observation_space, network.image_block_px)
        policy = new_policy(layout, space, network, 0, binary_entries(recipe))
        checkpoint.load_network(policy, tensors, path)
        return evaluate(env, policy, wanted, _noise(recipe, seed))
    finally:
        env.close()


def _noise(recipe: Recipe, seed: int) -> ActionNoise | None:
    draws = recipe.draws_actions
    return ActionNoise(torch.Generator().manual_seed(seed)) if draws else None
