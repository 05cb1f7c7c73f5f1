"""Reading of JSON episode files, with errors that name episode and field."""

from __future__ import annotations

import gzip
import json
import math
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

from hab_tasks.errors import EpisodeError, UnknownNameError
from hab_tasks.geometry import Pose7


def _can_turn(pose: Pose7) -> str:
    size = math.hypot(*pose[3:])
    return "" if 0 < size < math.inf else "a pose whose quaternion is neither zero nor too large"


Pose = Annotated[Pose7, _can_turn]

LARGEST_BYTES = 256 * 2**20
"""Maximum uncompressed size of an episode file: some hundred thousand episodes."""


def load_json(file: Path) -> Any:
    """Returns the content of a ``.json`` or ``.json.gz`` file.

    Raises:
        EpisodeError: Absent, not a regular file, too large, or damaged.
    """
    try:
        if file.exists() and not file.is_file():
            raise EpisodeError(f"{file}: not a regular file.")
        with gzip.open(file) if file.suffix == ".gz" else file.open("rb") as stream:
            data = stream.read(LARGEST_BYTES + 1)
        if len(data) > LARGEST_BYTES:
            raise EpisodeError(f"{file}: more than {LARGEST_BYTES // 2**20} MiB of JSON.")
        return json.loads(data)
    except FileNotFoundError as error:
        raise EpisodeError(f"{file}: no such file.") from error
    except RecursionError as error:
        raise EpisodeError(f"{file}: not a valid episode file (nested too deeply).") from error
    except (OSError, EOFError, ValueError, zlib.error) as error:
        raise EpisodeError(f"{file}: not a valid episode file ({error}).") from error


@contextmanager
def naming(where: str, name: str) -> Iterator[None]:
    """Adds episode and field to errors about missing, malformed or unknown values."""
    try:
        yield
    except KeyError as error:
        raise EpisodeError(f"{where}, field {name}: {error} is missing.") from error
    except UnknownNameError as error:
        raise EpisodeError(f"{where}, field {name}: {error}") from error
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise EpisodeError(f"{where}, field {name}: malformed ({error}).") from error
