"""Episodes: data model, files, generation, and writing to the simulator."""

from hab_tasks.episodes.making import EpisodeMaker, Wanted, load_episodes
from hab_tasks.episodes.schema import (
    Episode,
    EpisodeRequest,
    EpisodeSet,
    read_episodes,
    write_episodes,
)
from hab_tasks.episodes.source import open_source

__all__ = [
    "Episode",
    "EpisodeMaker",
    "EpisodeRequest",
    "EpisodeSet",
    "Wanted",
    "load_episodes",
    "open_source",
    "read_episodes",
    "write_episodes",
]
