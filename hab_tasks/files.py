"""Files that are whole or not there, and places that may be written to."""

from __future__ import annotations

import functools
import os
import secrets
import shutil
import socket
import time
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from hab_tasks.errors import FileError

ASIDE = ".partial-"
"""What is being written has a name that begins like this."""

STALE_S = 24 * 3600.0
"""What another machine left half written is removed when it is older than this."""


@contextmanager
def written_aside(path: Path) -> Iterator[Path]:
    """Gives a path beside `path` to write to; at the end that file takes its place.

    When something goes wrong, what was written is removed and an older file stays as it was.
    Several threads, processes and machines may write the same file: each writes its own, and one
    of them stays. What a killed process left is removed by the next that writes in its folder.

    Raises:
        FileError: `path` cannot be written: no room, no right, not a regular file.
    """
    with _refusing(path):
        target = _regular(path)
        target.parent.mkdir(parents=True, exist_ok=True)
        _remove_leftovers(target.parent)
    scratch = _beside(target)
    try:
        with _refusing_room(path, scratch):
            yield scratch
            scratch.replace(target)
    finally:
        scratch.unlink(missing_ok=True)


@contextmanager
def folder_written_aside(path: Path) -> Iterator[Path]:
    """Gives an empty folder beside `path` to fill; at the end that folder takes its place.

    When something goes wrong, what was filled is removed and an older folder stays as it was.

    Raises:
        FileError: `path` cannot be written.
    """
    with _refusing(path):
        target = _folder(path)
        scratch, old = _beside(target), target.with_name(f".{target.name}.old")
        if old.exists() and not target.exists():  # killed while they changed places
            old.rename(target)
        shutil.rmtree(old, ignore_errors=True)
        target.parent.mkdir(parents=True, exist_ok=True)
        _remove_leftovers(target.parent)
        scratch.mkdir()
    try:
        with _refusing_room(path, scratch):
            yield scratch
            if target.exists():
                target.rename(old)
            scratch.rename(target)
    finally:
        if old.exists() and not target.exists():
            old.rename(target)
        shutil.rmtree(scratch, ignore_errors=True)
        shutil.rmtree(old, ignore_errors=True)


def make_scratch_folder(folder: Path) -> Path:
    """Makes an empty folder in `folder`; what killed processes left there is removed.

    The next that makes one removes it, should this process be killed.

    Raises:
        FileError: `folder` cannot be written to.
    """
    with _refusing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        _remove_leftovers(folder)
        scratch = _beside(folder / "files")
        scratch.mkdir()
    return scratch


@contextmanager
def scratch_folder(folder: Path) -> Iterator[Path]:
    """Gives an empty folder in `folder`, which is removed in the end.

    Raises:
        FileError: `folder` cannot be written to.
    """
    scratch = make_scratch_folder(folder)
    try:
        with _refusing_room(folder, scratch):
            yield scratch
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


@contextmanager
def _refusing_room(path: Path, scratch: Path) -> Iterator[None]:
    """Names `path` when the system refuses what is written at `scratch`: the disk is full, ..."""
    try:
        yield
    except OSError as error:
        if isinstance(error, FileNotFoundError) and error.filename2 is not None:
            raise  # what was to take its place was never written
        if error.filename is None or str(error.filename).startswith(str(scratch)):
            raise FileError(path, f"cannot be written: {error.strerror or error}") from error
        raise


def check_file(path: Path, *, force: bool) -> None:
    """Refuses a file that cannot be written, before minutes are spent on what goes into it.

    Args:
        path: The file; its folders need not exist yet.
        force: Whether a file that is there may be replaced.

    Raises:
        FileError: There is one and `force` is False, it is not a regular file, or its folder
            cannot be written to.
    """
    with _refusing(path):
        target = _regular(path)
        if target.exists() and not force:
            raise FileError(path, "exists; give --force to replace it")
        _check_room(path, target.parent)


def check_folder(path: Path, *, force: bool, mark: str) -> None:
    """Refuses a folder that cannot be written to, before minutes are spent.

    Args:
        path: The folder; it need not exist yet.
        force: Whether the files in it may be replaced.
        mark: Name of a file that is in every folder that the command has made.

    Raises:
        FileError: It holds something and `force` is False, it was not made by the command, it is
            not a folder, or it cannot be written to.
    """
    with _refusing(path):
        target = _folder(path)
        if target.is_dir() and any(target.iterdir()):
            if not (target / mark).is_file():
                raise FileError(
                    path,
                    f"holds files and no {mark}: this command has not made it, so not even "
                    "--force replaces it; give another folder",
                )
            if not force:
                raise FileError(path, "exists; give --force to replace it")
        _check_room(path, target)


@contextmanager
def _refusing(path: Path) -> Iterator[None]:
    """Names `path` when the system refuses it: too long, a NUL in it, a file for a folder, ..."""
    try:
        yield
    except OSError as error:
        raise FileError(path, f"cannot be written: {error.strerror or error}") from error
    except ValueError as error:
        raise FileError(path, f"cannot be written: {error}") from error


def _without_links(path: Path) -> Path:
    """Returns where `path` leads; refuses a link to nothing, and names that no file can have."""
    with suppress(FileNotFoundError, NotADirectoryError):
        path.lstat()  # too long, or a NUL in it
    if not path.is_symlink():
        return path
    target = Path(os.path.realpath(path))
    if not target.exists():
        raise FileError(path, f"is a link to {os.readlink(path)}, which does not exist")
    return target


def _regular(path: Path) -> Path:
    """Returns the file that `path` leads to; refuses what is there and is not a regular file."""
    target = _without_links(path)
    if target.exists() and not target.is_file():
        raise FileError(path, f"is {_kind(target)}; give the name of a file")
    return target


def _folder(path: Path) -> Path:
    """Returns the folder that `path` leads to; refuses what is there and is not a folder."""
    target = _without_links(path)
    if target.exists() and not target.is_dir():
        raise FileError(path, f"is {_kind(target)}; give the name of a folder")
    return target


def _kind(path: Path) -> str:
    if path.is_dir():
        return "a folder"
    return "a file" if path.is_file() else "a device, pipe or socket"


def _check_room(path: Path, folder: Path) -> None:
    """Refuses `path` unless a file can be made in `folder`, or in what there is of it."""
    there = folder
    while not there.exists():
        there = there.parent
    if not there.is_dir():
        raise FileError(path, f"cannot be written: {there} is {_kind(there)}, not a folder")
    if not os.access(there, os.W_OK | os.X_OK):
        raise FileError(path, f"cannot be written: no right to write in {there}")


def _beside(target: Path) -> Path:
    """Returns a name beside `target` that nobody else writes to, with its suffix."""
    own = f"{ASIDE}{_machine()}-{os.getpid()}-{secrets.token_hex(6)}"
    return target.with_name(own + target.suffix)


def _remove_leftovers(folder: Path) -> None:
    """Removes what killed processes left half written in a folder."""
    for file in folder.glob(f"{ASIDE}*"):
        machine, _, rest = file.name.removeprefix(ASIDE).partition("-")
        pid = rest.partition("-")[0]
        if machine == _machine() and pid.isdigit():
            left = not _runs(int(pid))
        else:
            left = time.time() - _changed_s(file) > STALE_S
        if left and file.is_dir():
            shutil.rmtree(file, ignore_errors=True)
        elif left:
            file.unlink(missing_ok=True)


def _changed_s(file: Path) -> float:
    try:
        return file.lstat().st_mtime
    except FileNotFoundError:  # it has just taken its place
        return time.time()


def _runs(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    return True


@functools.cache
def _machine() -> str:
    """Returns a name of those who count their processes together: a computer or a container."""
    boot, processes = Path("/proc/sys/kernel/random/boot_id"), Path("/proc/self/ns/pid")
    names = [
        socket.gethostname(),
        boot.read_text() if boot.is_file() else "",
        str(processes.stat().st_ino) if processes.exists() else "",
    ]
    return f"{zlib.crc32(' '.join(names).encode()):08x}"
