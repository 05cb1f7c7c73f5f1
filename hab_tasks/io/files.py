"""Atomic writes of files and folders, and checks of output paths."""

from __future__ import annotations

import functools
import os
import secrets
import shutil
import socket
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from hab_tasks.errors import FileError

ASIDE = ".partial-"
"""Name prefix of partial files and folders."""

STALE_S = 24 * 3600.0
"""Age from which partial files of other machines are removed."""


@contextmanager
def written_aside(path: Path) -> Iterator[Path]:
    """Yields a temporary path beside `path`; on exit, that file replaces `path`.

    On an error, the temporary file is removed and an existing file is kept. Concurrent writers
    (threads, processes, machines) use separate temporary files, and the last one wins. Partial
    files of killed processes are removed by the next writer in the folder.

    Raises:
        FileError: `path` cannot be written: disk full, no permission, not a regular file.
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
    """Yields a temporary folder beside `path`; on exit, that folder replaces `path`.

    On an error, the temporary folder is removed and an existing folder is kept.

    Raises:
        FileError: `path` cannot be written.
    """
    with _refusing(path):
        target = _folder(path)
        scratch = _beside(target)
        _bring_back(target)
        target.parent.mkdir(parents=True, exist_ok=True)
        _remove_leftovers(target.parent)
        scratch.mkdir()
    try:
        with _refusing_room(path, scratch):
            yield scratch
            replace_folder(scratch, target)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def replace_folder(source: Path, target: Path) -> None:
    """Moves folder `source` to `target`, and then removes the replaced folder.

    If this process is killed between the two moves, the next writer restores the old folder.
    """
    _bring_back(target)
    try:
        if target.exists():
            target.rename(_old(target))
        source.rename(target)
    finally:
        _bring_back(target)


def _old(target: Path) -> Path:
    return target.with_name(f".{target.name}.old")


def _bring_back(target: Path) -> None:
    """Rolls back an interrupted replacement, and removes the old folder of a finished one."""
    old = _old(target)
    if old.exists() and not target.exists():
        old.rename(target)
    shutil.rmtree(old, ignore_errors=True)


def make_scratch_folder(folder: Path) -> Path:
    """Creates an empty folder in `folder`; removes those of killed processes.

    If this process is killed, the next call removes its folder.

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
    """Yields an empty folder in `folder`, which is removed on exit.

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
    """Reports `path` if writing to `scratch` fails, e.g. because the disk is full."""
    try:
        yield
    except OSError as error:
        if isinstance(error, FileNotFoundError) and error.filename2 is not None:
            raise  # the temporary file was never written
        if error.filename is None or str(error.filename).startswith(str(scratch)):
            raise FileError(path, f"cannot be written: {error.strerror or error}") from error
        raise


def check_file(path: Path, *, force: bool) -> None:
    """Checks that a file can be written, before its content is computed.

    Raises:
        FileError: It exists and `force` is False, it is not a regular file, or its folder is not
            writable.
    """
    with _refusing(path):
        target = _regular(path)
        if target.exists() and not force:
            raise FileError(path, "exists; give --force to replace it")
        _check_room(path, target.parent)


def check_folder(path: Path, *, force: bool, mark: str) -> None:
    """Checks that a folder can be written, before its content is computed.

    `mark` is a file that the command writes to each of its folders.

    Raises:
        FileError: It is not empty and `force` is False, it was not created by the command, it is
            not a folder, or it is not writable.
    """
    with _refusing(path):
        target = _folder(path)
        if target.is_dir() and any(target.iterdir()):
            if not (target / mark).is_file():
                raise FileError(
                    path,
                    f"contains files but no {mark}, so it was not created by this command and "
                    "--force does not replace it; give another folder",
                )
            if not force:
                raise FileError(path, "exists; give --force to replace it")
        _check_room(path, target)


@contextmanager
def _refusing(path: Path) -> Iterator[None]:
    """Reports `path` on system errors: name too long, NUL in it, a file used as a folder, ..."""
    try:
        yield
    except OSError as error:
        raise FileError(path, f"cannot be written: {error.strerror or error}") from error
    except ValueError as error:
        raise FileError(path, f"cannot be written: {error}") from error


def _without_links(path: Path) -> Path:
    """Resolves links; rejects broken links and invalid names."""
    with suppress(FileNotFoundError, NotADirectoryError):
        path.lstat()  # raises if the name is too long or has a NUL in it
    if not path.is_symlink():
        return path
    target = Path(os.path.realpath(path))
    if not target.exists():
        raise FileError(path, f"is a link to {os.readlink(path)}, which does not exist")
    return target


def _regular(path: Path) -> Path:
    """Resolves links to a file; rejects anything existing that is not a regular file."""
    target = _without_links(path)
    if target.exists() and not target.is_file():
        raise FileError(path, f"is {_kind(target)}; give the name of a file")
    return target


def _folder(path: Path) -> Path:
    """Resolves links to a folder; rejects anything existing that is not a folder."""
    target = _without_links(path)
    if target.exists() and not target.is_dir():
        raise FileError(path, f"is {_kind(target)}; give the name of a folder")
    return target


def _kind(path: Path) -> str:
    if path.is_dir():
        return "a folder"
    return "a file" if path.is_file() else "a device, pipe or socket"


def _check_room(path: Path, folder: Path) -> None:
    """Checks that a file can be created in `folder`, or in its closest existing parent."""
    there = folder
    while not there.exists():
        there = there.parent
    if not there.is_dir():
        raise FileError(path, f"cannot be written: {there} is {_kind(there)}, not a folder")
    if not os.access(there, os.W_OK | os.X_OK):
        raise FileError(path, f"cannot be written: no write permission in {there}")


def _beside(target: Path) -> Path:
    """Returns a unique temporary name beside `target`, with its suffix."""
    own = f"{ASIDE}{_machine()}-{os.getpid()}-{secrets.token_hex(6)}"
    return target.with_name(own + target.suffix)


def _remove_leftovers(folder: Path) -> None:
    """Removes partial files of killed processes from a folder."""
    for file in folder.glob(f"{ASIDE}*"):
        machine, _, rest = file.name.removeprefix(ASIDE).partition("-")
        pid = rest.partition("-")[0]
        if machine == _machine() and pid.isdigit():
            left = not _runs(int(pid))
        else:
            left = _age_s(file) > STALE_S
        if left and file.is_dir():
            shutil.rmtree(file, ignore_errors=True)
        elif left:
            file.unlink(missing_ok=True)


def _age_s(file: Path) -> float:
    """Returns the time since a file was changed, by its disk's clock: a machine's may be wrong."""
    try:
        with tempfile.TemporaryFile(dir=file.parent) as new:
            return os.fstat(new.fileno()).st_mtime - file.lstat().st_mtime
    except FileNotFoundError:  # just renamed by its writer
        return 0.0


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
    """Returns the name of the process id namespace: a machine or a container."""
    boot, processes = Path("/proc/sys/kernel/random/boot_id"), Path("/proc/self/ns/pid")
    names = [
        socket.gethostname(),
        boot.read_text() if boot.is_file() else "",
        str(processes.stat().st_ino) if processes.exists() else "",
    ]
    return f"{zlib.crc32(' '.join(names).encode()):08x}"
