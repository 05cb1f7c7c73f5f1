"""File names of submissions, and submissions by name."""

from __future__ import annotations

import os
import re
from pathlib import Path

from hab_eval.leaderboard import default_submissions
from hab_eval.plain_text import plain
from hab_eval.results import RunRecord
from hab_tasks.errors import OptionError, UnknownNameError

LONGEST_NAME = 150
WORD_START = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")
UNSAFE = re.compile(r"[^a-z0-9_]+")


def submission_name(record: RunRecord) -> str:
    """Returns ``<agent>-<env>-<dataset>-seed<S>``, e.g. ``spa_priv-pick-replica_cad-seed2``."""
    agent = record.agent.rpartition(":")[2]
    env = re.sub(r"^Hab(?=[A-Z])|-v\d+$", "", record.env.rpartition(":")[2])
    parts = [_snake(part) for part in (agent, env, record.scene_dataset)]
    parts += [_snake(part) for part in record.split.split("+")[1:]]  # held-out objects, ...
    return "-".join([*parts, f"seed{record.seed}"])


def find_submission(name: str, folder: Path | None) -> Path:
    """Returns the file of a submission: a run.json, a run folder, or a name in the folder.

    Raises:
        UnknownNameError: There is no such file; the message has the nearest name.
    """
    path = Path(name)
    if os.path.isfile(path / "run.json"):  # unlike Path.is_file, False for an invalid name
        return path / "run.json"
    if path.suffix == ".json" and (path.parent != Path() or os.path.isfile(path)):
        return path  # reading it reports a missing file
    folder = folder or default_submissions()
    known = {one.stem for one in folder.glob("*.json")} if os.path.isdir(folder) else set()
    stem = name.removesuffix(".json")
    if stem not in known:
        raise UnknownNameError(f"submission in {folder}", name, known)
    return folder / f"{stem}.json"


def check_name(name: str) -> str:
    """Returns the stem of a submission's file; raises unless it is a plain file name."""
    if not re.fullmatch(r"[A-Za-z0-9._-]+", name) or name.startswith("."):
        raise OptionError(
            f"--name {plain(name)!r}: it has to consist of letters, digits, '-', '_' and '.'."
        )
    if len(name) > LONGEST_NAME:
        raise OptionError(f"--name has {len(name)} characters; at most {LONGEST_NAME} are valid.")
    return name.removesuffix(".json")


def _snake(text: str) -> str:
    """``replicaCAD`` -> ``replica_cad``."""
    return UNSAFE.sub("_", WORD_START.sub("_", text).lower()).strip("_") or "unnamed"
