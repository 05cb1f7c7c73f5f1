"""Requirements of a submission."""

from __future__ import annotations

from hab_eval.errors import ResultError
from hab_eval.leaderboard import FEW_EPISODES
from hab_eval.provenance import COMMIT_SEPARATOR
from hab_eval.results import RunRecord
from hab_tasks.errors import shown


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
    head = f"{record.env.rpartition(':')[2]}/{record.scene_dataset}/{record.split}/{record.seed}"
    for index, episode in enumerate(record.episodes):
        wanted = f"{head}/{index:05d}"
        if episode.id != wanted:
            raise ResultError(
                f"{where}: episodes[{index}]: id is {shown(episode.id)}; the protocol of env, "
                f"scene_dataset, split and seed has {shown(wanted)}."
            )
