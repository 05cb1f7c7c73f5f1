"""Persistent cache of data computed from datasets (``HAB_CACHE_DIR``).

The default folder is ``~/.cache/hab_tasks``; it is created on first write. Damaged entries are
recomputed. If the folder is not writable, entries last as long as the process, with one warning.
"""

from __future__ import annotations

import atexit
import logging
import os
import shutil
import tempfile
import zlib
from collections import OrderedDict
from collections.abc import Callable, Hashable
from pathlib import Path
from typing import TypeVar
from zipfile import BadZipFile

from hab_tasks.errors import DatasetError, FileError, HabError
from hab_tasks.io.files import make_scratch_folder, written_aside

logger = logging.getLogger(__name__)

T = TypeVar("T")
Write = Callable[[Path], None]

DAMAGED = (
    *(HabError, OSError, ValueError, LookupError, TypeError, AttributeError),
    *(EOFError, BadZipFile, zlib.error),
)
"""Exceptions raised on reading a damaged file."""

RUN_DIR = "HAB_RUN_DIR"
"""Environment variable in which processes pass on their `run_dir`."""

_said: set[str] = set()


def cache_dir() -> Path:
    """Returns the cache folder; it may not exist yet."""
    chosen = os.environ.get("HAB_CACHE_DIR")
    if chosen:
        return Path(os.path.expanduser(chosen)).absolute()
    folder = os.environ.get("XDG_CACHE_HOME")
    return (Path(folder) if folder else Path(os.path.expanduser("~/.cache"))) / "hab_tasks"


def run_dir() -> Path:
    """Returns a folder that is removed when this process ends; processes that it starts use it.

    Raises:
        HabError: No temporary folder is writable.
    """
    folder = _run_dir()
    if folder is None or not folder.is_dir():
        folder = temporary_folder()
        os.environ[RUN_DIR] = str(folder)
        atexit.register(_remove_of, folder, os.getpid())
    return folder


def _run_dir() -> Path | None:
    return Path(os.environ[RUN_DIR]) if RUN_DIR in os.environ else None


def temporary_folder() -> Path:
    """Creates a temporary folder, and removes those of killed processes.

    Raises:
        HabError: No temporary folder can be created.
    """
    try:
        return make_scratch_folder(Path(tempfile.gettempdir()))
    except (OSError, FileError) as error:
        raise HabError(f"cannot create a temporary folder ({error}); set TMPDIR.") from error


def find(name: str) -> Path | None:
    """Returns the path of a cache entry, or None."""
    folders = (_run_dir(), cache_dir())
    return next((f / name for f in folders if f is not None and os.path.lexists(f / name)), None)


def read_cached(name: str, read: Callable[[Path], T]) -> T | None:
    """Reads an entry; returns None if it is absent or damaged. Removes damaged ones.

    `read` raises one of `DAMAGED` for a damaged entry.
    """
    path = find(name)
    if path is None:
        return None
    try:
        if not path.is_file() and not path.is_dir():
            raise ValueError("no file")  # reading a pipe would block
        return read(path)
    except DAMAGED as error:
        reason = " ".join(str(error).split()).removeprefix(f"{path}: ")
        warn_once(f"{path}: damaged cache entry ({reason}); it is recomputed.")
        _remove(path)
        return None


def write_cached(name: str, write: Write) -> Path:
    """Writes an entry atomically; returns its path.

    If the cache is not writable, the entry is written to `run_dir`.
    """
    path = cache_dir() / name
    try:
        with written_aside(path) as scratch:
            write(scratch)
        return path
    except (OSError, HabError) as error:
        cause = error if isinstance(error, OSError) else error.__cause__
        if isinstance(error, DatasetError) or not isinstance(cause, OSError):
            raise
        say_unwritable(cause)
    path = run_dir() / name
    with written_aside(path) as scratch:
        write(scratch)
    return path


def writable_dir(name: str) -> Path:
    """Returns a folder of the cache that other libraries write to; of this run if not writable."""
    folder = cache_dir() / name
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError as error:
        say_unwritable(error)
    folder = run_dir() / name
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def cached(name: str, write: Write, read: Callable[[Path], T]) -> T:
    """Returns an entry as read by `read`; `write` creates it if absent or damaged."""
    kept = read_cached(name, lambda path: (read(path),))
    return read(write_cached(name, write)) if kept is None else kept[0]


def cached_file(name: str, write: Write, check: Callable[[Path], object] | None = None) -> Path:
    """Returns an entry's path; `write` creates it if it is absent or fails `check`."""

    def read(path: Path) -> Path:
        path.stat()
        if check is not None:
            check(path)
        return path

    return cached(name, write, read)


def recalled(kept: OrderedDict[Hashable, T], key: Hashable, make: Callable[[], T], most: int) -> T:
    """Returns an entry in memory, made if absent; drops the one that was not used for longest."""
    if key in kept:
        kept.move_to_end(key)
        return kept[key]
    made = kept[key] = make()
    if len(kept) > most:
        kept.popitem(last=False)
    return made


def say_unwritable(cause: OSError) -> None:
    """Warns that nothing is kept in the cache, once in this process."""
    warn_once(
        f"{cache_dir()}: the cache is not writable ({cause.strerror or cause}); entries are "
        "kept for this run only. Set HAB_CACHE_DIR to a writable folder."
    )


def warn_once(message: str) -> None:
    """Logs a warning, once in this process."""
    if message not in _said:
        _said.add(message)
        logger.warning(message)


def _remove(path: Path) -> None:
    """Removes a file or folder; ignores failures."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
        return
    try:
        path.unlink(missing_ok=True)
    except OSError:
        logger.debug("%s: cannot be removed", path)


def _remove_of(folder: Path, process: int) -> None:
    """Removes a folder at exit of the process that created it, but not of its forks."""
    if os.getpid() == process:
        shutil.rmtree(folder, ignore_errors=True)
