"""Submissions: their requirements, their file names, and how they are found."""

from __future__ import annotations

import os
import re
import zlib
from itertools import chain
from pathlib import Path

from hab_eval.errors import ResultError
from hab_eval.records.config import robot_asked
from hab_eval.records.leaderboard import FEW_EPISODES, default_submissions
from hab_eval.records.plain_text import plain
from hab_eval.records.provenance import COMMIT_SEPARATOR
from hab_eval.records.results import RunRecord
from hab_tasks.episodes.schema import EpisodeRequest
from hab_tasks.episodes.source import variant_of
from hab_tasks.errors import OptionError, UnknownNameError, shown
from hab_tasks.robots import DEFAULT_ROBOT

LONGEST_NAME = 150
WORD_START = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")
UNSAFE = re.compile(r"[^a-z0-9_]+")


def submission_name(record: RunRecord) -> str:
    """Returns ``<agent>-<env>-<dataset>-seed<S>``, e.g. ``spa_priv-pick-replica_cad-seed2``.

    A hash of the agent's options follows, if there are any: it is another agent with others.
    """
    agent = record.agent.rpartition(":")[2]
    env = re.sub(r"^Hab(?=[A-Z])|-v\d+$", "", record.env.rpartition(":")[2])
    parts = [_snake(part) for part in (agent, env, record.scene_dataset)]
    parts += [_snake(part) for part in record.split.split("+")[1:]]  # held-out objects, ...
    parts += [record.instructions] if record.instructions != "fixed" else []
    parts += [f"seed{record.seed}"]
    if record.options:
        parts += [
            f"options{zlib.crc32(chr(0).join(chain(*sorted(record.options.items()))).encode()):08x}"
        ]
    return "-".join(parts)


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


def check_submission(record: RunRecord, where: str) -> None:
    """Checks that others can rerun a result and that it has enough episodes.

    Raises:
        ResultError: It has too few episodes, no clean commit, or episodes of another protocol.
    """
    _check_commit(record.git, where)
    _check_agent(record, where)
    count = len(record.episodes)
    if count < FEW_EPISODES:
        raise ResultError(
            f"{where}: {count} episodes; a submission has at least {FEW_EPISODES}. Run "
            f"hab-eval run with --episodes {FEW_EPISODES} or more."
        )
    _check_episode_ids(record, where)


def _check_commit(git: str | None, where: str) -> None:
    if git is None:
        raise ResultError(
            f"{where}: git is null, so the run was not made in a checkout; repeat it in a clone of "
            "the repository."
        )
    if COMMIT_SEPARATOR in git:
        raise ResultError(
            f"{where}: git is {shown(git)}: the run was resumed on another commit. Repeat it on "
            "one commit with hab-eval run --force."
        )
    if git.endswith("-dirty"):
        raise ResultError(
            f"{where}: git is {shown(git)}: the sources had uncommitted changes. Commit them and "
            "repeat the run with hab-eval run --force."
        )


def _check_agent(record: RunRecord, where: str) -> None:
    git = None if record.agent_files is None else record.agent_files.git
    if git is not None and (COMMIT_SEPARATOR in git or git.endswith("-dirty")):
        raise ResultError(
            f"{where}: agent_files: git is {shown(git)}: the agent's code had uncommitted changes "
            "or changed during the run. Commit it and repeat the run with hab-eval run --force."
        )


def cleanliness(record: RunRecord) -> str:
    """Returns a line that says which commits the run was made on."""
    files = record.agent_files
    if files is None or files.git is None:
        code = "unknown" if files is None else files.code[:12]
        return f"clean: commit {record.git}. The agent's code (SHA-256 {code}) is in no repository."
    return f"clean: commit {record.git}, and the agent's code at commit {files.git}."


def _check_episode_ids(record: RunRecord, where: str) -> None:
    """Checks that the episodes are the first ones of the set of the run's protocol."""
    split, _, novel = record.split.partition("+")
    robot = robot_asked(record.env_options) or DEFAULT_ROBOT.uid
    # Clutter is added to an episode, which keeps its id.
    asked = EpisodeRequest(env_id=record.env, novel=novel or None, robot=robot)
    scope = f"{record.scene_dataset}/{split}{variant_of(asked)}"
    head = f"{record.env.rpartition(':')[2]}/{scope}/{record.seed}"
    for index, episode in enumerate(record.episodes):
        wanted = f"{head}/{index:05d}"
        if episode.id != wanted:
            raise ResultError(
                f"{where}: episodes[{index}]: id is {shown(episode.id)}; the protocol of env, "
                f"scene_dataset, split and seed has {shown(wanted)}."
            )
