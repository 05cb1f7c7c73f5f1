"""Generated episodes as JSON, with their rejections; shared by processes through a folder."""

from __future__ import annotations

import json
from collections import Counter
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from hab_tasks.episodes.fields import Pose
from hab_tasks.episodes.generators.base import Made
from hab_tasks.episodes.schema import Episode, with_loose
from hab_tasks.errors import EpisodeError
from hab_tasks.geometry import Pose7
from hab_tasks.io.cache import DAMAGED
from hab_tasks.io.files import written_aside
from hab_tasks.typed_values import read_value

Scenes = dict[str, dict[str, Pose7]]
"""Layout -> poses of its loose objects."""


def made_to_json(made: Made, known: Scenes) -> dict[str, Any]:
    """Returns an episode as JSON, with the loose objects of its layout unless in `known`."""
    entry = asdict(made.episode)
    raw = {"rejections": dict(made.rejections), "episode": entry}
    loose, scene = entry.pop("loose"), made.episode.scene_id
    if known.get(scene) != made.episode.loose:
        known[scene] = made.episode.loose
        raw["loose"] = loose
    return raw


@dataclass(frozen=True, kw_only=True)
class _Entry:
    """What `made_to_json` returns, with the index that a journal adds."""

    episode: Episode
    rejections: dict[str, int]
    loose: dict[str, Pose] | None = None
    index: int = 0


def made_from_json(raw: Any, known: Scenes, where: str) -> tuple[int, Made]:
    """Returns index and episode of the result of `made_to_json`; adds loose objects to `known`.

    Raises:
        EpisodeError: A field is missing or malformed.
    """
    entry = read_value(_Entry, raw, where, EpisodeError)
    if entry.loose is not None:
        known[entry.episode.scene_id] = entry.loose
    episode = with_loose(entry.episode, known, where)
    return entry.index, Made(episode=episode, rejections=Counter(entry.rejections))


class SharedEpisodes:
    """Episodes of one source that several processes generate; each uses those of the others."""

    def __init__(self, folder: Path, key: int) -> None:
        """Uses files in `folder` that start with the key of the source."""
        self._folder, self._key = folder, key

    def find(self, index: int) -> Made | None:
        """Returns an episode that another process has generated, None without one."""
        file = self._file(index)
        try:
            return made_from_json(json.loads(file.read_bytes()), {}, str(file))[1]
        except DAMAGED:  # absent, as a rule
            return None

    def has(self, index: int) -> bool:
        """Returns whether there is a file of an episode."""
        return self._file(index).exists()

    def publish(self, index: int, made: Made) -> None:
        """Shares an episode.

        Raises:
            FileError: There is no room for it.
        """
        with written_aside(self._file(index)) as scratch:
            scratch.write_text(json.dumps(made_to_json(made, {})), encoding="utf-8")

    def remove(self, count: int) -> None:
        """Removes the first `count` episodes, and the folder if nothing else is in it."""
        for index in range(count):
            self._file(index).unlink(missing_ok=True)
        with suppress(OSError):
            self._folder.rmdir()

    def _file(self, index: int) -> Path:
        return self._folder / f"{self._key:08x}-{index}.json"
