"""Tables of the status page, and the rows that they are of."""

import hashlib
import subprocess
from dataclasses import replace

import pytest
import stub_runs
from hab_eval.records.leaderboard import default_submissions, read_submissions
from hab_eval.records.provenance import COMMIT_SEPARATOR
from hab_eval.records.status import best_table, rows_table
from stub_runs import make_record

from hab_tasks.registration import SKILLS, TASKS

CURRENT = {
    **dict.fromkeys(SKILLS, "0.2.0"),
    **dict.fromkeys(("HabPlace-v1", "HabCloseFridge-v1", "HabNavigate-v1", *TASKS), "0.3.0"),
}
"""Environment -> first version in which driven policies play and are judged as today."""


def agent(name, wins, episodes, **changes):
    outcomes = (True,) * wins + (False,) * (episodes - wins)
    return replace(make_record(outcomes, **changes), agent=name)


def last_row(found):
    return best_table(found, "B.md").splitlines()[-1]


def test_the_best_of_each_kind_is_chosen_among_rows():
    found = dict(
        planner=agent("hab_spa:spa_priv", 9, 10, privileged=True),
        policy=agent("hab_ppo:pick_blind", 7, 10, handle_position=True),
        worse=agent("hab_ppo:pick_worse", 6, 10),
        there=agent("hab_ppo:pick_depth", 10, 10, scene_dataset="replicaCAD"),
        sensed=agent("hab_spa:spa", 8, 10),
        other=agent("hab_spa:spa_priv", 10, 10, env_options={"robot": "panda_mobile"}),
        random=agent("hab_eval:random_agent", 10, 10),
    )
    where = "B.md#habpick-v1-apartment"
    assert last_row(found) == (
        f"| HabPick-v1 | [spa]({where}): 80.0 % (n = 10) "
        f"| [pick_blind ‡]({where}): 70.0 % (n = 10) "
        f"| [spa_priv †]({where}): 90.0 % (n = 10) | 86.3 % (MonolithicRL, depth; Table 3) |"
    )


def test_every_row_is_in_the_table():
    new = agent("a:new", 4, 5, objects="ycb", env_options={"robot": "r"})
    # 4 of 5: Wilson 37.6 to 96.4.
    (row,) = rows_table({"a.json": new}, "B.md").splitlines()[2:]
    assert row == (
        "| HabPick-v1 | [new](B.md#habpick-v1-apartment-objects-ycb-changed-environment-robotr) | "
        "80.0 [37.6, 96.4] | 5 | apartment, ycb; robot=r | val | 0.1.0 |"
    )


def git(*arguments, given=""):
    """Runs git on the checkout; its output as bytes."""
    command = ["git", "-C", stub_runs.ROOT, *arguments]
    if not (stub_runs.ROOT / ".git").exists():
        pytest.skip("not a git checkout")
    return subprocess.run(command, input=given.encode(), capture_output=True, check=True).stdout


def test_no_row_is_of_an_older_version_or_a_lost_commit():
    current = read_submissions(default_submissions())
    assert not [n for n, r in current.items() if r.versions["hab-tasks"] < CURRENT[r.env]]
    commits = {
        one.partition("-")[0]
        for record in current.values()
        for one in (record.git or "").split(COMMIT_SEPARATOR)
    }
    names = "\n".join(f"{commit}^{{commit}}" for commit in sorted(commits))
    assert b"missing" not in git("cat-file", "--batch-check", given=names)


def test_the_weights_of_every_row_are_in_its_commit():
    records = read_submissions(default_submissions()).values()
    weights = {
        (record.git, name, digest)
        for record in records
        if record.agent_files is not None
        for name, digest in record.agent_files.data.items()
    }
    for commit, name, digest in sorted(weights):
        content = git("show", f"{commit}:baselines/ppo/{name}")
        assert hashlib.sha256(content).hexdigest() == digest, name
