"""Sampling of the next episode of a row."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from functools import cached_property
from operator import index
from typing import Any

import numpy as np

from hab_tasks.episodes.schema import Episode
from hab_tasks.episodes.source import EpisodeSource
from hab_tasks.errors import EpisodeError

SEEDS = 2**31


class EpisodeSampler:
    """Samples the episodes of one row.

    Attributes:
        episode: The episode; available after the first choice.
        seed: Seed it was sampled with, drawn if none was given; 0 before the first choice.
    """

    episode: Episode

    def __init__(self, source: EpisodeSource, num_episodes: int) -> None:
        """Samples from the first `num_episodes` of `source`."""
        self.source = source
        self._most = source.available
        self._num_episodes = self._drawn = min(num_episodes, self._most)
        self._order = np.random.default_rng(source.seed)
        self.seed = 0

    def draw_from(self, first: int) -> None:
        """Draws further episodes from the `first` of them."""
        self._drawn = min(first, self._num_episodes)

    def choose(self, seed: int | None, wanted: Any) -> None:
        """Chooses the next episode: `wanted`, its index in the set, or None for any.

        The seed determines this episode, and those of later choices without a seed.

        Raises:
            EpisodeError: The set has no episode of this index.
        """
        if seed is None:
            # Draw a seed, so that recorders can store one that reproduces the episode.
            seed = int(self._order.integers(SEEDS, size=1)[0])
        else:
            # Streams of one seed: 0 draws this episode, 1 those after it.
            self._order = np.random.default_rng([self.source.seed, seed, 1])
        if isinstance(wanted, Episode):
            self.episode = wanted
        elif wanted is not None:
            self.episode = self.source.get(self._known(wanted))
        else:
            drawn = np.random.default_rng([seed, 0])
            self.episode = self.source.get(int(drawn.integers(self._drawn)))
        self.seed = seed

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


@dataclass(frozen=True)
class ActiveLayout:
    """The layout and the movable objects in the simulation."""

    layout: str
    objects: tuple[str, ...]

    @cached_property
    def checksum(self) -> int:
        """A number of 32 bits that differs for other layouts and objects."""
        return zlib.crc32(repr((self.layout, self.objects)).encode())
