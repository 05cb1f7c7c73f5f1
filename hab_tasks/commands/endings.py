"""Check of the suffix of episode files."""

from __future__ import annotations

from pathlib import Path

from hab_tasks.errors import HabError

EPISODE_ENDINGS = (".json", ".json.gz")


def check_ending(file: Path) -> None:
    """Raises HabError for an episode file without a valid suffix."""
    if not file.name.endswith(EPISODE_ENDINGS):
        raise HabError(f"--out {file}: an episode file must end in {' or '.join(EPISODE_ENDINGS)}.")
