"""Which episode each row of a batch plays next."""

from __future__ import annotations

from operator import index
from typing import Any

import numpy as np

from hab_tasks.episodes.schema import Episode
from hab_tasks.episodes.source import EpisodeSource
from hab_tasks.errors import EpisodeError

DRAWS = 1000
SEEDS = 2**31


class EpisodeChoice:
    """Draws episodes; a batch shares one layout.

    Attributes:
        episodes: The episode of each row, in order; empty before the first choice.
        seeds: What each was drawn with, also where no seed was given; 0 before the first choice.
    """

    def __init__(self, source: EpisodeSource, num_episodes: int, num_envs: int) -> None:
        """Draws from the first `num_episodes` of `source`."""
        self.source = source
        self._most = source.available
        self._num_episodes = min(num_episodes, self._most)
        self._num_envs = num_envs
        self._order = np.random.default_rng(source.seed)
        self.episodes: list[Episode] = []
        self.seeds = [0] * num_envs

    def choose(
        self, rows: list[int], seed: int | list[int] | None, wanted: Any, shown: Shown
    ) -> None:
        """Chooses the next episode of each of `rows`.

        Args:
            rows: Which rows start anew.
            seed: Chooses the episodes, and those of later choices without one.
            wanted: An `Episode`, its index in the set, a list with one for each row, or None.
            shown: What a partial reset has to make do with.

        Raises:
            EpisodeError: The set has no episode of this index, or it plays in another layout than
                the rest of the batch.
        """
        if seed is None:
            # Drawn, so that a recorder has a seed to ask for the same episode with.
            seeds = self._order.integers(SEEDS, size=len(rows)).tolist()
        else:
            seeds = np.broadcast_to(seed, len(rows)).tolist()
            self._order = np.random.default_rng([self.source.seed, *seeds, 1])
        wishes = wanted if isinstance(wanted, (list, tuple)) else [wanted] * len(rows)
        if len(wishes) != len(rows):
            raise EpisodeError(f"{len(wishes)} episodes for {len(rows)} rows; give one for each.")
        # A batch shares one layout; a partial reset goes on in the one there is.
        partial = len(rows) < self._num_envs
        layout = shown.layout if partial else None
        chosen: list[Episode | None] = [*self.episodes] or [None] * self._num_envs
        for row, row_seed, wish in zip(rows, seeds, wishes, strict=True):
            # Rows of one batch share a seed argument but not an episode.
            rng = np.random.default_rng([row_seed, row])
            episode = self._pick(rng, wish, layout, shown if partial else None)
            self.seeds[row] = row_seed
            if layout not in (None, episode.scene_id):
                raise EpisodeError(f"{episode.id}: in {episode.scene_id}, the batch in {layout}.")
            chosen[row], layout = episode, episode.scene_id
        self.episodes = [episode for episode in chosen if episode is not None]

    def _pick(
        self, rng: np.random.Generator, wish: Any, scene_id: str | None, shown: Shown | None
    ) -> Episode:
        if isinstance(wish, Episode):
            return wish
        if wish is not None:
            return self.source.get(self._known(wish))
        for _ in range(DRAWS):
            episode = self.source.get(int(rng.integers(self._num_episodes)))
            if scene_id in (None, episode.scene_id) and (shown is None or shown.fits(episode)):
                return episode
        raise AssertionError(f"no episode in {scene_id}, though one was played there")

    def _known(self, wish: Any) -> int:
        """Returns the index that a wish is, if the set has it."""
        count = self._num_episodes
        try:
            number = index(wish)
        except TypeError as error:
            raise EpisodeError(f"Episode {wish!r} is neither an index nor an Episode.") from error
        if not 0 <= number < count:
            more = f"; num_episodes={number + 1} has it" if count <= number < self._most else ""
            raise EpisodeError(f"Episode {number}: of {count}, valid are 0 to {count - 1}{more}.")
        return number


class Shown:
    """The layout and the movable objects that are in the simulation."""

    def __init__(self, layout: str = "", objects: tuple[str, ...] = ()) -> None:
        self.layout, self.objects = layout, objects

    def fits(self, episode: Episode) -> bool:
        """Whether an episode can start with these."""
        return episode.scene_id == self.layout and set(episode.objects) <= set(self.objects)
