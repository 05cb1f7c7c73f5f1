"""Lock of a run folder: one run at a time.

The lock is a `flock` on an open file, which the kernel releases when the process ends for whatever
reason. The content of the file only names the owner.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import socket
import time
from collections.abc import Generator
from pathlib import Path

from hab_eval.errors import RunFolderError
from hab_tasks.errors import FileError

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
