"""The run folder: `config.json`, journal and traces during the run, `run.json` at the end.

Its lock admits one run at a time. It is a `flock` on an open file, which the kernel releases when
the process ends for whatever reason; the content of the file only names the owner.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import json
import os
import socket
import time
from collections.abc import Container, Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hab_eval.errors import ResultError, RunFolderError
from hab_eval.records.config import (
    SavedConfig,
    describe_difference,
    read_config,
    write_config,
)
from hab_eval.records.results import FinishedEpisode, check_episode, check_size
from hab_eval.records.schema import read_dataclass
from hab_tasks.errors import FileError, shown
from hab_tasks.io.files import ASIDE, check_folder, written_aside
from hab_tasks.typed_values import name_episode, parse_json, to_json

UNFINISHED = f"{ASIDE}*"
"""Temporary files left by a killed run; the next run removes them."""

OWN_FILES = (
    "config.json",
    "episodes.jsonl",
    "traces.jsonl",
    "run.json",
    "error.txt",
    "video_*.mp4",
    "video_*.png",
    UNFINISHED,
)
"""Files of a run; `--force` removes these and nothing else."""


@dataclass(frozen=True, kw_only=True)
class RunFolder:
    """Paths of a run's files, and its journal of finished episodes."""

    root: Path

    @property
    def config_path(self) -> Path:
        """The resolved configuration."""
        return self.root / "config.json"

    @property
    def journal_path(self) -> Path:
        """One finished episode per line."""
        return self.root / "episodes.jsonl"

    @property
    def traces_path(self) -> Path:
        """The agent's traces, one episode per line; only if the agent reports traces."""
        return self.root / "traces.jsonl"

    @property
    def record_path(self) -> Path:
        """The result."""
        return self.root / "run.json"

    @property
    def error_path(self) -> Path:
        """Traceback of the error that stopped the run."""
        return self.root / "error.txt"

    def discard(self) -> None:
        """Removes the configuration of a run that never started."""
        self.config_path.unlink(missing_ok=True)

    def append(self, finished: FinishedEpisode) -> None:
        """Appends an episode to the journal, and its trace if there is one; syncs both to disk.

        Raises:
            FileError: The disk is full.
        """
        line = to_json(finished)
        trace = line.pop("trace")
        if trace:
            # The trace is first, so that no episode in the journal lacks its trace.
            _add_line(self.traces_path, {"id": finished.episode.id, "trace": trace})
        _add_line(self.journal_path, line)

    def read_journal(self) -> dict[str, FinishedEpisode]:
        """Returns the finished episodes by id; truncates an incomplete last line."""
        check_size(self.journal_path)
        found: dict[str, FinishedEpisode] = {}
        for number, line in enumerate(_whole_lines(self.journal_path), start=1):
            where = f"{self.journal_path}: line {number}"
            finished = _parse(line, where)
            if finished.episode.id in found:
                raise ResultError(f"{where}: episode {finished.episode.id!r} appears twice.")
            found[finished.episode.id] = finished
        return found

    def cut_traces(self, finished: Container[str]) -> None:
        """Removes the traces of episodes that are not finished, which will run again."""
        path, lines = self.traces_path, _whole_lines(self.traces_path)
        numbered = enumerate(lines, start=1)
        kept = [one for n, one in numbered if _traced(one, f"{path}: line {n}") in finished]
        if len(kept) < len(lines):
            with written_aside(self.traces_path) as scratch:
                scratch.write_text("".join(f"{line}\n" for line in kept), encoding="utf-8")


def check_free(root: Path, *, resume: bool, force: bool) -> None:
    """Checks that the folder is free, or that `resume` or `force` says what to do with its files.

    Raises:
        RunFolderError: It is not; the message lists the options.
        FileError: The path cannot be written to, or is not a folder.
    """
    if resume and force:
        raise RunFolderError(
            "--resume keeps the finished episodes, --force drops them: give only one."
        )
    there = os.path.isdir(root)  # unlike Path.is_dir, False for an invalid name
    if not there:
        check_folder(root, force=force, mark="config.json")
    taken = there and any(path.name != LOCK for path in root.iterdir())
    if taken and not (resume or force):
        raise RunFolderError(
            f"--out {root} already exists. Use --resume to continue its run, --force to replace "
            "it, or another folder."
        )
    if taken and resume and not RunFolder(root=root).config_path.is_file():
        raise RunFolderError(f"--out {root} has no config.json, so there is no run to resume.")


def open_folder(
    root: Path, saved: SavedConfig, *, resume: bool, force: bool
) -> tuple[RunFolder, SavedConfig]:
    """Prepares the folder of a new run, or checks that an old run can be resumed as `saved`.

    Returns:
        The folder, and the saved configuration; a resumed run keeps its earlier commits.
    """
    check_free(root, resume=resume, force=force)
    folder = RunFolder(root=root)
    root.mkdir(parents=True, exist_ok=True)
    for pattern in OWN_FILES if force else (UNFINISHED,):
        for path in root.glob(pattern):
            path.unlink()
    if resume and folder.config_path.is_file():
        before = read_config(folder.config_path)
        difference = describe_difference(before, saved)
        if difference:
            raise RunFolderError(f"--out {root} belongs to another run: {difference}.")
        saved = before.resumed(saved)
    write_config(folder.config_path, saved)
    folder.error_path.unlink(missing_ok=True)
    return folder, saved


def _add_line(path: Path, value: dict[str, Any]) -> None:
    """Appends a line of JSON and syncs it to disk."""
    line = json.dumps(value, allow_nan=False) + "\n"
    try:
        with path.open("a", encoding="utf-8") as file:
            file.write(line)
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise FileError(path, f"cannot be written: {error.strerror or error}") from error


def _whole_lines(path: Path) -> list[str]:
    """Returns the lines of a file, [] if it does not exist; truncates an incomplete last line."""
    if not path.exists():
        return []
    if not path.is_file():
        raise ResultError(f"{path}: not a regular file.")
    whole, newline, torn = path.read_bytes().rpartition(b"\n")
    if torn:
        with path.open("r+b") as file:
            file.truncate(len(whole) + len(newline))
    lines = whole.split(b"\n") if whole else []
    return [_decoded(line, f"{path}: line {n}") for n, line in enumerate(lines, start=1)]


def _decoded(line: bytes, where: str) -> str:
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ResultError(f"{where}: not valid UTF-8 text: {error}") from error


def _parse(line: str, where: str) -> FinishedEpisode:
    data = _parse_line(line, where)
    try:
        finished = read_dataclass(FinishedEpisode, data, where=where)
    except ResultError as error:
        entry = data.get("episode") if isinstance(data, dict) else None
        raise ResultError(f"{error}{name_episode(entry)}") from error
    check_episode(finished.episode, where)
    return finished


def _traced(line: str, where: str) -> str:
    """Returns the episode id of a line of traces."""
    data = _parse_line(line, where)
    name = data.get("id") if isinstance(data, dict) else None
    if not isinstance(name, str):
        raise ResultError(f"{where}: expected an object with an id, got {shown(data)}.")
    return name


def _parse_line(line: str, where: str) -> Any:
    try:
        return parse_json(line)
    except ValueError as error:
        raise ResultError(f"{where}: cannot be read as JSON: {error}") from error


LOCK = ".lock"

NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)
"""Some network file systems do not support locks; runs there are not locked."""

NAMED_WITHIN_S = 2.0
"""An owner names itself after it has the lock; it may be asked for in between."""


@contextlib.contextmanager
def locked(root: Path) -> Generator[None, None, None]:
    """Locks the folder `root`; creates it if needed, and removes it again if it stays empty.

    Raises:
        RunFolderError: Another process holds the lock; the message has its pid and host.
        FileError: The folder cannot be written to.
    """
    made = [folder for folder in (root, *root.parents) if not folder.exists()]
    path = root / LOCK
    try:
        try:
            root.mkdir(parents=True, exist_ok=True)
            file = _hold(path)
        except OSError as error:
            raise FileError(path, f"cannot be written: {error.strerror or error}") from error
        try:
            yield
        finally:
            path.unlink(missing_ok=True)  # before the release: the next owner makes a new file
            os.close(file)
    finally:
        with contextlib.suppress(OSError):  # the folder is not empty
            for folder in made:
                folder.rmdir()


def _hold(path: Path) -> int:
    """Acquires the lock; returns the open lock file."""
    while True:
        file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno not in NO_LOCKS:
                owner = _owner(file)
                os.close(file)
                raise RunFolderError(_busy(path.parent, owner)) from error
        if _is_at(file, path):
            os.ftruncate(file, 0)
            os.pwrite(file, f"process {os.getpid()} on {socket.gethostname()}".encode(), 0)
            return file
        os.close(file)  # the owner removed the file between our two calls


def _owner(file: int) -> str:
    """Returns what the owner of a lock calls itself."""
    end = time.monotonic() + NAMED_WITHIN_S
    while not (name := os.pread(file, 1000, 0)) and time.monotonic() < end:
        time.sleep(0.01)
    return name.decode("utf-8", "replace") or "another process"


def _is_at(file: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(file), path.stat())
    except FileNotFoundError:
        return False


def _busy(root: Path, owner: str) -> str:
    return f"--out {root} is in use by {owner}. Wait until it has finished, or use another folder."
