"""Sampling of the next episode of each row of a batch."""

from __future__ import annotations

import zlib
from operator import index
from typing import Any

import numpy as np

from hab_tasks.episodes.schema import Episode
from hab_tasks.episodes.source import EpisodeSource
from hab_tasks.errors import EpisodeError

DRAWS = 1000
SEEDS = 2**31


class EpisodeSampler:
    """Samples episodes; all rows of a batch share one layout.

    Attributes:
        episodes: The episode of each row; empty before the first choice.
        seeds: Seed each episode was sampled with, drawn if none was given; 0 before the first
            choice.
    """

    def __init__(self, source: EpisodeSource, num_episodes: int, num_envs: int) -> None:
        """Samples from the first `num_episodes` of `source`."""
        self.source = source
        self._most = source.available
        self._num_episodes = min(num_episodes, self._most)
        self._num_envs = num_envs
        self._order = np.random.default_rng(source.seed)
        self.episodes: list[Episode] = []
        self.seeds = [0] * num_envs

    def choose(
        self, rows: list[int], seed: int | list[int] | None, wanted: Any, shown: ActiveLayout
    ) -> None:
        """Chooses the next episode of each of `rows`.

        Args:
            rows: Rows to reset.
            seed: Determines these episodes, and those of later choices without a seed.
            wanted: An `Episode`, its index in the set, a list with one per row, or None.
            shown: The active layout, which a partial reset has to keep.

        Raises:
            EpisodeError: The set has no episode of this index, or its layout differs from that of
                the rest of the batch.
        """
        if seed is None:
            # Draw a seed, so that recorders can store one that reproduces the episode.
            seeds = self._order.integers(SEEDS, size=len(rows)).tolist()
        else:
            seeds = np.broadcast_to(seed, len(rows)).tolist()
            self._order = np.random.default_rng([self.source.seed, *seeds, 1])
        wishes = wanted if isinstance(wanted, (list, tuple)) else [wanted] * len(rows)
        if len(wishes) != len(rows):
            raise EpisodeError(f"{len(wishes)} episodes for {len(rows)} rows; pass one per row.")
        # All rows share one layout; a partial reset keeps the active one.
        partial = len(rows) < self._num_envs
        layout = shown.layout if partial else None
        chosen: list[Episode | None] = [*self.episodes] or [None] * self._num_envs
        for row, row_seed, wish in zip(rows, seeds, wishes, strict=True):
            # Rows share the seed argument but get different episodes.
            rng = np.random.default_rng([row_seed, row])
            episode = self._pick(rng, wish, layout, shown if partial else None)
            self.seeds[row] = row_seed
            if layout not in (None, episode.scene_id):
                raise EpisodeError(f"{episode.id}: in {episode.scene_id}, the batch in {layout}.")
            chosen[row], layout = episode, episode.scene_id
        self.episodes = [episode for episode in chosen if episode is not None]

    def _pick(
        self, rng: np.random.Generator, wish: Any, scene_id: str | None, shown: ActiveLayout | None
    ) -> Episode:
        if isinstance(wish, Episode):
            return wish
        if wish is not None:
            return self.source.get(self._known(wish))
        for _ in range(DRAWS):
            episode = self.source.get(int(rng.integers(self._num_episodes)))
            if scene_id in (None, episode.scene_id) and (shown is None or shown.fits(episode)):
                return episode
        raise AssertionError(f"no episode in {scene_id}, although it is the active layout")

    def _known(self, wish: Any) -> int:
        """Returns a requested episode as a valid index of the set."""
        count = self._num_episodes
        try:
            number = index(wish)
        except TypeError as error:
            raise EpisodeError(f"Episode {wish!r} is neither an index nor an Episode.") from error
        if not 0 <= number < count:
            more = f"; num_episodes={number + 1} has it" if count <= number < self._most else ""
            raise EpisodeError(f"Episode {number}: valid indices are 0 to {count - 1}{more}.")
        return number


class ActiveLayout:
    """The layout and the movable objects in the simulation.

    Attributes:
        checksum: A number of 32 bits that differs for other layouts and objects.
    """

    def __init__(self, layout: str = "", objects: tuple[str, ...] = ()) -> None:
        self.layout, self.objects = layout, objects
        self.checksum = zlib.crc32(repr((layout, objects)).encode())

    def fits(self, episode: Episode) -> bool:
        """Whether an episode can start without rebuilding."""
        return episode.scene_id == self.layout and set(episode.objects) <= set(self.objects)
