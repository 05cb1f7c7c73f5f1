"""Files that are whole or not there."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ASIDE = ".partial-"
"""What is being written has a name that begins like this."""


@contextmanager
def written_aside(path: Path) -> Iterator[Path]:
    """Gives a path beside `path` to write to; at the end that file takes its place.

    When something goes wrong, what was written is removed and an older file stays as it was.
    Several processes may write the same file: each writes its own, and one of them stays.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    scratch = path.with_name(f"{ASIDE}{os.getpid()}-{path.name}")
    try:
        yield scratch
        scratch.replace(path)
    finally:
        scratch.unlink(missing_ok=True)
