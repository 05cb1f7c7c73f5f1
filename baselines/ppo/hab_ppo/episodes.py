"""The episodes of a recipe."""

from __future__ import annotations

from hab_ppo.progress import WriteLine
from hab_ppo.recipe import Recipe
from hab_tasks.episodes import Episode, EpisodeRequest, load_episodes


def training_request(recipe: Recipe) -> EpisodeRequest:
    """Returns the request of a recipe's training episodes."""
    return _request(recipe, recipe.env.training_reference, recipe.env.split)


def _request(recipe: Recipe, env_id: str, split: str) -> EpisodeRequest:
    env = recipe.env
    return EpisodeRequest(
        env_id=env_id,
        scene_dataset=env.scene_dataset,
        objects=env.objects,
        split=split,
        seed=env.episode_seed,
    )


def training_episodes(recipe: Recipe, workers: int, write_line: WriteLine) -> tuple[Episode, ...]:
    """Returns the training episodes of a recipe; the missing ones are generated."""
    return _loaded(training_request(recipe), recipe.env.num_episodes, workers, write_line)


def prepare_episodes(recipe: Recipe, workers: int, write_line: WriteLine) -> tuple[Episode, ...]:
    """Generates the missing episodes of a recipe; returns those of the evaluation."""
    training_episodes(recipe, workers, write_line)
    request = _request(recipe, recipe.env.reference, recipe.evaluation_split)
    return _loaded(request, recipe.evaluation_episodes, workers, write_line)


def _loaded(
    request: EpisodeRequest, count: int, workers: int, write_line: WriteLine
) -> tuple[Episode, ...]:
    def say(done: int, count: int) -> None:
        if done < count and done % max(1, count // 10) == 0:
            write_line(f"{done} of {count} episodes generated")

    return load_episodes(request, count, say, workers).episodes
