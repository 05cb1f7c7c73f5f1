"""The episodes of a run: training starts with the first ones while processes make the others.

Rows draw from the first n training episodes, where n depends on the steps of complete updates
alone: what a run draws is the same however fast episodes are made. A run that is ahead of them
waits.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, Self

from hab_ppo.distributed import Ranks
from hab_ppo.progress import WriteLine
from hab_ppo.recipe import Recipe
from hab_tasks.episodes import Episode, EpisodeMaker, EpisodeRequest, Wanted, open_source
from hab_tasks.episodes.source import EpisodeSource

FIRST = 200
"""Number of training episodes with which a run starts."""

STEPS_PER_EPISODE = 100
"""One more is drawn from after so many steps, about as many as rows play."""


def training_source(recipe: Recipe) -> EpisodeSource:
    """Returns the source of a recipe's training episodes."""
    return open_source(_training(recipe))


def drawn_from(recipe: Recipe, steps: int) -> int:
    """Returns the number of training episodes that rows draw from after so many steps."""
    return min(recipe.env.num_episodes, FIRST + steps // STEPS_PER_EPISODE)


def check_episodes(recipe: Recipe) -> None:
    """Rejects environments of a recipe that have no episodes.

    Raises:
        HabError: Unknown dataset, split or objects, damaged data, or no start state was found.
    """
    for request in (_training(recipe), _evaluation(recipe)):
        open_source(request).get(0)


class EpisodeSupply:
    """The episodes of a rank's run; the first rank of a machine starts the processes."""

    def __init__(self, recipe: Recipe, ranks: Ranks, write_line: WriteLine) -> None:
        """Starts to make the missing episodes."""
        self._recipe, self._ranks = recipe, ranks
        self._shown: tuple[Any, int] = (None, 0)
        wanted = self._wanted() if ranks.is_first_on_machine else []
        self._maker = EpisodeMaker(wanted, ranks.on_machine)
        if self._maker.is_busy:
            first, count = drawn_from(recipe, 0), recipe.env.num_episodes
            write_line(f"generating {count:,} episodes; training starts with the first {first}")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def end(self) -> None:
        """Ends the processes."""
        self._maker.end()

    def grow(self, env: Any, steps: int) -> None:
        """Lets rows draw from as many training episodes as there have to be after these steps."""
        now = env, drawn_from(self._recipe, steps)
        if now == self._shown:
            return
        if self._ranks.is_first_on_machine:
            self._maker.wait(2, now[1])
        self._ranks.meet()
        env.call("draw_from", now[1])
        self._shown = now

    @cached_property
    def evaluation(self) -> tuple[Episode, ...]:
        """The episodes of the evaluations."""
        if self._ranks.is_first_on_machine:
            self._maker.wait(1)
        self._ranks.meet()
        count = self._recipe.evaluation_episodes
        return open_source(_evaluation(self._recipe)).to_set(count).episodes

    def _wanted(self) -> list[Wanted]:
        recipe, training = self._recipe, _training(self._recipe)
        return [
            Wanted(training, drawn_from(recipe, 0)),
            Wanted(_evaluation(recipe), recipe.evaluation_episodes),
            Wanted(training, recipe.env.num_episodes, later=True),
        ]


def _training(recipe: Recipe) -> EpisodeRequest:
    return _request(recipe, recipe.env.training_reference, recipe.env.split)


def _evaluation(recipe: Recipe) -> EpisodeRequest:
    return _request(recipe, recipe.env.reference, recipe.evaluation_split)


def _request(recipe: Recipe, env_id: str, split: str) -> EpisodeRequest:
    env = recipe.env
    return EpisodeRequest(
        env_id=env_id,
        scene_dataset=env.scene_dataset,
        objects=env.objects,
        split=split,
        seed=env.episode_seed,
        robot=env.robot_reference,
    )
