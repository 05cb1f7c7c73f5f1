"""What is computed from datasets, kept between runs in one folder (``HAB_CACHE_DIR``).

The default is ``~/.cache/hab_tasks``. The folder is made when something is written to it. A damaged
entry is made anew, and where the folder cannot be written to, results last as long as the process;
a warning says so once.
"""

from __future__ import annotations

import atexit
import logging
import os
import shutil
import tempfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar
from zipfile import BadZipFile

from hab_tasks.errors import DatasetError, FileError, HabError
from hab_tasks.files import make_scratch_folder, written_aside

logger = logging.getLogger(__name__)

T = TypeVar("T")
Write = Callable[[Path], None]

DAMAGED = (
    *(HabError, OSError, ValueError, LookupError, TypeError, AttributeError),
    *(EOFError, BadZipFile, zlib.error),
)
"""What reading a damaged file raises."""

_said: set[str] = set()
_run_dir: Path | None = None


def cache_dir() -> Path:
    """Returns the folder for everything computed from a dataset; it may not be there yet."""
    chosen = os.environ.get("HAB_CACHE_DIR")
    if chosen:
        return Path(os.path.expanduser(chosen)).absolute()
    place = os.environ.get("XDG_CACHE_HOME")
    return (Path(place) if place else Path(os.path.expanduser("~/.cache"))) / "hab_tasks"


def run_dir() -> Path:
    """Returns a folder that is removed when this process ends.

    Raises:
        HabError: No temporary folder can be written to.
    """
    global _run_dir
    if _run_dir is None or not _run_dir.is_dir():
        _run_dir = temporary_folder()
        atexit.register(_remove_of, _run_dir, os.getpid())
    return _run_dir


def temporary_folder() -> Path:
    """Makes a folder among the system's temporary files, and removes those of killed processes.

    Raises:
        HabError: None can be made.
    """
    try:
        return make_scratch_folder(Path(tempfile.gettempdir()))
    except (OSError, FileError) as error:
        raise HabError(f"no temporary folder can be made ({error}); set TMPDIR to one.") from error


def use_run_dir(folder: Path) -> None:
    """Shares the `run_dir` of the process that started this one."""
    global _run_dir
    _run_dir = folder


def find(name: str) -> Path | None:
    """Returns an entry of the cache, None where there is none."""
    folders = [cache_dir()] if _run_dir is None else [_run_dir, cache_dir()]
    return next((f / name for f in folders if os.path.lexists(f / name)), None)


def read_cached(name: str, read: Callable[[Path], T]) -> T | None:
    """Returns what `read` makes of an entry; None when it is absent, or damaged and so removed.

    Args:
        name: The entry, a path relative to the folder.
        read: Reads it; one of `DAMAGED` from it means that the entry is damaged.
    """
    path = find(name)
    if path is None:
        return None
    try:
        if not path.is_file() and not path.is_dir():
            raise ValueError("no file")  # a pipe would never end to be read
        return read(path)
    except DAMAGED as error:
        reason = " ".join(str(error).split()).removeprefix(f"{path}: ")
        _say_once(f"{path}: damaged in the cache ({reason}); it is made anew.")
        _remove(path)
        return None


def write_cached(name: str, write: Write) -> Path:
    """Writes an entry aside, then renames it; returns its path.

    Where the cache cannot be written to, the entry goes to `run_dir`.
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
        _say_once(
            f"{cache_dir()}: the cache cannot be written to ({cause.strerror or cause}); results "
            "are kept for this run only. Set HAB_CACHE_DIR to a folder that can be written to."
        )
    path = run_dir() / name
    with written_aside(path) as scratch:
        write(scratch)
    return path


def cached(name: str, write: Write, read: Callable[[Path], T]) -> T:
    """Returns what `read` makes of an entry, which `write` makes when it is absent or damaged."""
    kept = read_cached(name, lambda path: (read(path),))
    return read(write_cached(name, write)) if kept is None else kept[0]


def cached_file(name: str, write: Write, check: Callable[[Path], object] | None = None) -> Path:
    """Returns an entry's path; `write` makes the entry when it is absent or fails `check`."""

    def read(path: Path) -> Path:
        path.stat()
        if check is not None:
            check(path)
        return path

    return cached(name, write, read)


def _say_once(message: str) -> None:
    if message not in _said:
        _said.add(message)
        logger.warning(message)


def _remove(path: Path) -> None:
    """Removes a file or a folder, where that can be done."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
        return
    try:
        path.unlink(missing_ok=True)
    except OSError:
        logger.debug("%s: cannot be removed", path)


def _remove_of(folder: Path, process: int) -> None:
    """Removes a folder at the end of the process that made it, not of one forked from it."""
    if os.getpid() == process:
        shutil.rmtree(folder, ignore_errors=True)
