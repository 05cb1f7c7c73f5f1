"""Episodes: data model, files, generation, and writing to the simulator."""

from hab_tasks.episodes.schema import Episode, EpisodeSet, read_episodes, write_episodes
from hab_tasks.episodes.source import EpisodeRequest, load_episodes, open_source

__all__ = [
    "Episode",
    "EpisodeRequest",
    "EpisodeSet",
    "load_episodes",
    "open_source",
    "read_episodes",
    "write_episodes",
]
