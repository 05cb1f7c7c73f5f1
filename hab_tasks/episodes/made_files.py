"""Generated episodes as JSON, with their rejections; shared by processes through a folder."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Any

from hab_tasks.cache import DAMAGED
from hab_tasks.episodes.fields import naming, read_pose
from hab_tasks.episodes.generators.base import Made
from hab_tasks.episodes.schema import read_episode
from hab_tasks.errors import FileError
from hab_tasks.files import written_aside
from hab_tasks.geometry import Pose7
from hab_tasks.typed_values import integer, mapping

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


def made_from_json(raw: dict[str, Any], known: Scenes, where: str) -> Made:
    """Reads the result of `made_to_json`; adds loose objects to `known`.

    Raises:
        EpisodeError: A field is missing or malformed.
    """
    with naming(where, "rejections, loose"):
        entry = mapping(raw["episode"])
        rejections = {name: integer(n) for name, n in mapping(raw["rejections"]).items()}
        if "loose" in raw:
            poses = mapping(raw["loose"]).items()
            known[entry["scene_id"]] = {name: read_pose(pose) for name, pose in poses}
    return Made(episode=read_episode(entry, known, where), rejections=Counter(rejections))


class SharedEpisodes:
    """Episodes of one source that several processes generate; each uses those of the others."""

    def __init__(self, folder: Path, key: int) -> None:
        """Uses files in `folder` that start with the key of the source."""
        self._folder, self._key = folder, key

    def find(self, index: int) -> Made | None:
        """Returns an episode that another process has generated, None without one."""
        file = self._file(index)
        try:
            return made_from_json(json.loads(file.read_bytes()), {}, str(file))
        except DAMAGED:  # absent, as a rule
            return None

    def publish(self, index: int, made: Made) -> None:
        """Shares an episode; without room for it, the others generate it themselves."""
        try:
            with written_aside(self._file(index)) as scratch:
                scratch.write_text(json.dumps(made_to_json(made, {})), encoding="utf-8")
        except FileError:
            return

    def _file(self, index: int) -> Path:
        return self._folder / f"{self._key:08x}-{index}.json"
