"""Journal of an episode file in the making, so that a killed command can be resumed.

`OUT.journal` has one JSON object a line: first the configuration, then each episode with its index
and rejections. A layout's loose objects are in the first of its episodes.
"""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Any

from hab_tasks.episodes.fields import naming, read_pose
from hab_tasks.episodes.generators.base import Made
from hab_tasks.episodes.schema import SCHEMA, read_episode
from hab_tasks.errors import EpisodeError, FileError
from hab_tasks.files import check_file
from hab_tasks.geometry import Pose7
from hab_tasks.typed_values import integer, mapping

Configuration = dict[str, str | int | None]

VERSION = 1


class EpisodeJournal:
    """The journal of one episode file.

    Attributes:
        file: Path of the journal.
        entries: Episodes in the journal, by index.
    """

    def __init__(self, file: Path, configuration: Configuration) -> None:
        """Keeps episodes that are generated with this configuration."""
        self.file = file
        self.entries: dict[int, Made] = {}
        self._configuration = {"journal": VERSION, "schema": SCHEMA, **configuration}
        self._scenes: dict[str, dict[str, Pose7]] = {}

    def open(self, *, resume: bool, force: bool) -> None:
        """Reads the journal of an interrupted command, or begins a new one.

        Raises:
            EpisodeError: There is one, and neither `resume` nor `force` was given; it belongs to
                another configuration, or is damaged.
            FileError: It cannot be written.
        """
        check_file(self.file, force=True)
        there = self.file.exists()
        if there and not (resume or force):
            raise EpisodeError(
                f"{self.file} is of an interrupted run. Use --resume to continue it, or --force to "
                "start again."
            )
        lines = self._whole_lines() if there and resume else []
        if lines:
            self._read(lines)
        else:
            self._write(self._configuration, "w")

    def append(self, index: int, made: Made) -> None:
        """Appends an episode.

        Raises:
            FileError: The disk is full.
        """
        entry = asdict(made.episode)
        loose, scene = entry.pop("loose"), made.episode.scene_id
        line = {"index": index, "rejections": dict(made.rejections), "episode": entry}
        if self._scenes.get(scene) != made.episode.loose:
            self._scenes[scene] = made.episode.loose
            line["loose"] = loose
        self._write(line, "a")

    def remove(self) -> None:
        """Removes the journal of a finished file."""
        self.file.unlink(missing_ok=True)

    def _write(self, line: dict[str, Any], mode: str) -> None:
        try:
            with self.file.open(mode, encoding="utf-8") as file:
                file.write(json.dumps(line) + "\n")
        except OSError as error:
            raise FileError(self.file, f"cannot be written: {error.strerror or error}") from error

    def _whole_lines(self) -> list[bytes]:
        """Returns the lines; truncates an incomplete last one."""
        whole, newline, torn = self.file.read_bytes().rpartition(b"\n")
        if torn:
            with self.file.open("r+b") as file:
                file.truncate(len(whole) + len(newline))
        return whole.split(b"\n") if whole else []

    def _read(self, lines: list[bytes]) -> None:
        with naming(str(self.file), "line 1"):
            before = mapping(json.loads(lines[0]))
        now = self._configuration
        different = [
            f"{name}: {before.get(name)!r} before, {now.get(name)!r} now"
            for name in dict.fromkeys([*now, *before])
            if before.get(name) != now.get(name)
        ]
        if different:
            raise EpisodeError(f"{self.file} belongs to another run: {'; '.join(different)}.")
        for number, line in enumerate(lines[1:], start=2):
            self._read_entry(line, f"{self.file}: line {number}")

    def _read_entry(self, line: bytes, where: str) -> None:
        with naming(where, "index, rejections, loose"):
            raw = mapping(json.loads(line))
            index, entry = integer(raw["index"]), mapping(raw["episode"])
            rejections = {name: integer(n) for name, n in mapping(raw["rejections"]).items()}
            if "loose" in raw:
                poses = mapping(raw["loose"]).items()
                self._scenes[entry["scene_id"]] = {name: read_pose(pose) for name, pose in poses}
        episode = read_episode(entry, self._scenes, where)
        self.entries[index] = Made(episode=episode, rejections=Counter(rejections))


def journal_of(out: Path) -> Path:
    """Returns the path of the journal of an episode file."""
    return out.with_name(f"{out.name}.journal")
