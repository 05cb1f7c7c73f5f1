"""File names of videos, and the episodes of a run that are worth a video."""

from __future__ import annotations

import re

from hab_eval.records.results import RunRecord

UNSAFE = re.compile(r"[^A-Za-z0-9._-]+")


def video_name(index: int, episode_id: str) -> str:
    """Returns the file name of an episode's video, without suffix."""
    return f"video_{index:03d}_{UNSAFE.sub('-', episode_id)}"


def highlights(record: RunRecord) -> tuple[int, ...]:
    """Returns the indices of the first success and of the first failure of each category."""
    first: dict[str | None, int] = {}
    for index, episode in enumerate(record.episodes):
        first.setdefault(episode.failure, index)  # None for a success
    return tuple(sorted(first.values()))
