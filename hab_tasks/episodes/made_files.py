"""Generated episodes as JSON, with their rejections: shared by processes, and journals.

The journal of a file in the making, `OUT.journal`, lets a killed command be resumed. It has one
JSON object a line: the configuration, then each episode with its index. A layout's loose objects
are in the first of its episodes. Without any episode there is no journal.
"""

from __future__ import annotations

import json
from collections import Counter
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from hab_tasks.episodes.generators.base import Made
from hab_tasks.episodes.schema import SCHEMA, Episode, Pose, with_loose
from hab_tasks.errors import EpisodeError, FileError
from hab_tasks.geometry import Pose7
from hab_tasks.io.cache import DAMAGED
from hab_tasks.io.files import check_file, written_aside
from hab_tasks.typed_values import parse_json, read_value

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


Configuration = dict[str, str | int | None]

VERSION = 1


class EpisodeJournal:
    """The journal of one episode file, and its episodes (`entries`) by index."""

    def __init__(self, file: Path, configuration: Configuration) -> None:
        """Keeps episodes that are generated with this configuration."""
        self.file = file
        self.entries: dict[int, Made] = {}
        self._configuration = {"journal": VERSION, "schema": SCHEMA, **configuration}
        self._scenes: Scenes = {}
        self._begun = False

    def open(self, *, resume: bool, force: bool) -> None:
        """Reads the journal of an interrupted command, or begins a new one.

        Raises:
            EpisodeError: There is one, and neither `resume` nor `force` was given; it belongs to
                another configuration, or is damaged.
            FileError: It cannot be written.
        """
        check_file(self.file, force=True)
        lines = self._whole_lines()
        if lines and not (resume or force):
            raise EpisodeError(
                f"{self.file} is of an interrupted run. Use --resume to continue it, or --force to "
                "start again."
            )
        self._begun = bool(lines) and resume
        if self._begun:
            self._read(lines)
        else:
            self.remove()

    def append(self, index: int, made: Made) -> None:
        """Appends an episode.

        Raises:
            FileError: The disk is full.
        """
        entry = {"index": index, **made_to_json(made, self._scenes)}
        lines = [entry] if self._begun else [self._configuration, entry]
        text = "".join(f"{json.dumps(line)}\n" for line in lines)
        try:
            with self.file.open("a", encoding="utf-8") as file:
                file.write(text)
        except OSError as error:
            raise FileError(self.file, f"cannot be written: {error.strerror or error}") from error
        self._begun = True

    def remove(self) -> None:
        """Removes the journal of a finished file."""
        self.file.unlink(missing_ok=True)

    def _whole_lines(self) -> list[bytes]:
        """Returns the lines, [] if the file does not exist; truncates an incomplete last one."""
        if not self.file.exists():
            return []
        whole, newline, torn = self.file.read_bytes().rpartition(b"\n")
        if torn:
            with self.file.open("r+b") as file:
                file.truncate(len(whole) + len(newline))
        return whole.split(b"\n") if whole else []

    def _read(self, lines: list[bytes]) -> None:
        first = self._parsed(lines[0], "line 1")
        before = read_value(dict[str, Any], first, f"{self.file}: line 1", EpisodeError)
        now = self._configuration
        different = [
            f"{name}: {before.get(name)!r} before, {now.get(name)!r} now"
            for name in dict.fromkeys([*now, *before])
            if before.get(name) != now.get(name)
        ]
        if different:
            raise EpisodeError(f"{self.file} belongs to another run: {'; '.join(different)}.")
        for number, line in enumerate(lines[1:], start=2):
            raw, where = self._parsed(line, f"line {number}"), f"{self.file}: line {number}"
            index, made = made_from_json(raw, self._scenes, where)
            self.entries[index] = made

    def _parsed(self, line: bytes, where: str) -> Any:
        try:
            return parse_json(line)
        except ValueError as error:
            raise EpisodeError(f"{self.file}: {where} is not JSON ({error}).") from error
